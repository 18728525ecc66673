"""A process that helps: what it makes comes back, and what ends it is told, whenever it comes."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as Late
from typing import Any

import pytest

from crowdfence.simulation.recording.helping_process import HelperKilled, HelpingProcess
from support.helped_tasks import LARGE, fails, frame, frame_killed_while_handed_over

LONG_S = 60.0


@pytest.fixture
def helper() -> Iterator[HelpingProcess]:
    process = HelpingProcess()
    yield process
    process.kill()
    process.close()


def asked(helper: HelpingProcess, function: Callable[..., Any], *arguments: Any) -> Any:
    """A test does not wait for ever."""
    with ThreadPoolExecutor(1) as thread:
        answer = thread.submit(helper.call, function, *arguments)
        try:
            return answer.result(LONG_S)
        except Late:
            os.kill(helper._process.pid, signal.SIGKILL)
            raise


def test_answers_come_back(helper):
    assert [asked(helper, frame, number)[0] for number in range(3)] == [0, 1, 2]


@pytest.mark.parametrize("sent", [0, 1, 4, 100, LARGE // 2, LARGE])
def test_one_that_is_killed_while_it_hands_over_is_told_of(helper, sent):
    """Whoever waited for the rest of a frame waited for ever."""
    assert asked(helper, frame, 1)[0] == 1
    with pytest.raises(HelperKilled):
        asked(helper, frame_killed_while_handed_over, sent)
    with pytest.raises(HelperKilled):
        asked(helper, frame, 2)


def test_one_that_is_killed_before_it_has_read_its_task_is_told_of(helper):
    """A scene is more than a pipe takes: whoever had begun to hand it over waited for ever."""
    helper.kill()
    with pytest.raises(HelperKilled):
        asked(helper, len, bytes(100 * LARGE))


def test_it_leaves_it_to_its_parent_when_to_stop(helper):
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(helper._process.pid, number)  # from its first instruction on
        assert asked(helper, frame, 1)[0] == 1
        os.kill(helper._process.pid, number)
    assert asked(helper, frame, 2)[0] == 2
    assert not {signal.SIGINT, signal.SIGTERM} & signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_what_goes_wrong_there_goes_wrong_here(helper):
    with pytest.raises(FileNotFoundError, match=r"map\.tif") as caught:
        asked(helper, fails)
    assert "in fails" in str(caught.value.__cause__)
    assert asked(helper, frame, 1)[0] == 1
