"""States in a model, before it is calibrated, how vibrant it is shown pictures: `python shown_vibrant.py MODEL`.

Cameras show paler colours than the renderer. Measured on photographs (README.md, "Pale colours"), where a factor of
2 to 4 is about as good; rendered pictures lose nothing by it once the model is calibrated with it.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from crowdfence.calibration.model_file import write_with_contract
from crowdfence.detector.detector import Detector

VIBRANCE = 3.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("--vibrance", type=float, default=VIBRANCE, help="1 to 8")
    given = parser.parse_args()
    contract = Detector(given.model).contract
    if contract.rates is not None:
        sys.exit("error: the model is calibrated, for pictures as they were; give it as it was trained")
    # What joins several sizes is fitted once the model is calibrated: picture_sizes.py.
    shown = replace(contract, input=replace(contract.input, vibrance=given.vibrance), sizes=None)
    write_with_contract(given.model, shown, given.model)


if __name__ == "__main__":
    main()
