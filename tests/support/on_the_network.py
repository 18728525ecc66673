"""A service of this process behind a port, for clients that know no other way."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Thread
from typing import Any

import uvicorn

from crowdfence.service.app import make_app
from crowdfence.service.server import listen
from crowdfence.service.service import Service


@contextmanager
def on_the_network(service: Service, port: int = 0, **how: Any) -> Iterator[str]:
    """Its address."""
    config = uvicorn.Config(make_app(service, **how), port=port, log_config=None, ws_ping_interval=None)
    server, listening = uvicorn.Server(config), listen(config)
    thread = Thread(target=server.run, args=([listening],), daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"127.0.0.1:{listening.getsockname()[1]}"
    finally:
        server.should_exit = server.force_exit = True
        thread.join()
        listening.close()
