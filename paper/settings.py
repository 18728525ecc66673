"""The settings of Table 1, what the paper reports for them, and what it leaves open, one change at a time."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from crowdfence.config import EvidenceConfig, MethodConfig, OrConfig, PaperConfig

ALPHAS = (0.1, 0.2, 0.5, 0.8, 1.0)
DECAYS = (0.0, 0.0005, 0.05)
REPORTED_NO_FUSION = 0.127
REPORTED = {0.1: 0.249, 0.2: 0.199, 0.5: 0.158, 0.8: 0.134, 1.0: 0.107}
"""Mean IoU of the paper's Table 1 by alpha, each at its best decay."""

BEST_REPORTED = PaperConfig(alpha=0.1, decay=0.0005)
"""What the choices that the paper leaves open are changed from."""


class Setting(NamedTuple):
    """One method to fuse the looks with."""

    name: str
    """Different for every setting; also names its file."""
    method: MethodConfig


class Choice(NamedTuple):
    """One answer to a question that the paper leaves open."""

    question: str
    answer: str
    setting: Setting
    ours: bool = False
    """Whether Table 1 is made with it."""


def table_setting(alpha: float, decay: float) -> Setting:
    return Setting(f"alpha {alpha:g}, decay {decay:g}", PaperConfig(alpha=alpha, decay=decay))


NO_FUSION = Setting("no fusion", OrConfig())
EVIDENCE = Setting("evidence", EvidenceConfig())
TABLE = [NO_FUSION, *(table_setting(alpha, decay) for alpha in ALPHAS for decay in DECAYS)]

WEAKENED_DECAY = 0.0005
WEAKENED_TABLE = [NO_FUSION, *(table_setting(alpha, WEAKENED_DECAY) for alpha in ALPHAS)]
"""What the weakened detector is looked at with."""


def _choice(question: str, answer: str, **changed: object) -> Choice:
    method = replace(BEST_REPORTED, **changed)  # type: ignore[arg-type]
    ours = method == BEST_REPORTED
    name = table_setting(0.1, 0.0005).name if ours else f"{question} {answer}"
    return Choice(question, answer, Setting(name, method), ours)


CHOICES = (
    _choice("b threshold", "0.3", b_threshold=0.3),
    _choice("b threshold", "0.5", b_threshold=0.5),
    _choice("b threshold", "0.7", b_threshold=0.7),
    _choice("initial value", "0", initial="zero"),
    _choice("initial value", "prior", initial="prior"),
    _choice("initial value", "first look whole", initial="first"),
    _choice("decay 0.0005", "per second", decay_unit="second"),
    _choice("decay 0.0005", "per frame", decay_unit="frame"),
    Choice("decay 0.05", "per second", table_setting(0.1, 0.05)),
    _choice("decay 0.05", "per frame", decay=0.05, decay_unit="frame"),
    _choice("unseen drones", "m = 0, weight 1/N", unseen="fleet"),
    _choice("unseen drones", "left out", unseen="visible"),
    _choice("unseen drones", "left out, weights normalised", unseen="visible", normalise=True),
    _choice("prior", "share fit to land on", prior=None),
    _choice("prior", "0.02", prior=0.02),
    _choice("prior", "0.2", prior=0.2),
    _choice("prior", "0.5", prior=0.5),
)
"""The binarisation threshold is swept for every setting."""


def all_settings() -> list[Setting]:
    """Every setting once."""
    settings = [*TABLE, *(choice.setting for choice in CHOICES), EVIDENCE]
    return list(dict((setting.name, setting) for setting in settings).values())
