"""Coroutines run in a thread of their own: browser tests leave a loop running in the main one."""

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

AnswerT = TypeVar("AnswerT")


def run_apart(coroutine: Coroutine[None, None, AnswerT], within_s: float = 20.0) -> AnswerT:
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(lambda: asyncio.run(asyncio.wait_for(coroutine, within_s))).result()
