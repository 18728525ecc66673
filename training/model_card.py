"""States in models what they were trained on and how they do on photographs:

    crowdfence model evaluate MODEL --data PHOTOGRAPHS --json > photographs.json
    python model_card.py MODEL... --version 0.2.0 --photographs photographs.json

PHOTOGRAPHS is a folder with COCO annotations that took no part in training. `model check` shows all of it.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from crowdfence.calibration.model_file import write_with_contract
from crowdfence.detector.detector import Detector


def photographs(report: dict[str, Any]) -> dict[str, float]:
    """What `model evaluate --json` says of whole pictures, rounded to what so few of them tell."""
    pictures = report["pictures"]
    return {
        "pictures_with_crowd": pictures["pictures_with_crowd"],
        "mean_recall": round(pictures["mean_recall"], 2),
        "pictures_without_crowd": pictures["pictures_without_crowd"],
        "share_marked": round(pictures["mean_share_marked"], 4),
        "share_of_them_with_more_than_1_percent": round(pictures["share_with_more_than_one_percent"], 2),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("models", type=Path, nargs="+")
    parser.add_argument("--version", required=True, help="of the weights")
    parser.add_argument("--trained-on", default="rendered pictures only")
    parser.add_argument("--photographs", type=Path, help="report of `crowdfence model evaluate --json`")
    given = parser.parse_args()
    for path in given.models:
        contract = Detector(path).contract
        about = {**(contract.about or {}), "trained_on": given.trained_on}
        about.pop("photographs", None)
        if given.photographs is not None:
            about["photographs"] = photographs(json.loads(given.photographs.read_text()))
        stated = replace(contract, version=given.version, about=about)
        write_with_contract(path, stated, path)
        print(f"{path}: version {given.version}, {about}")


if __name__ == "__main__":
    main()
