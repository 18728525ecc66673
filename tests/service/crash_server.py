"""A live service on the small plain, in a process that a test can kill: crash_server.py FOLDER PORT."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from crowdfence.service.server import Address, serve
from support.small_service import SETTINGS, running


def main(folder: str, port: str) -> None:
    with running(Path(folder), settings=SETTINGS) as service:
        serve(service, Address(port=int(port)), lambda url: print(url, flush=True))


if __name__ == "__main__":
    main(*sys.argv[1:])
