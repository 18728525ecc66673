"""Methods beside each other on one recording, as a page with plots (`crowdfence evaluate --report`)."""

from crowdfence.evaluation.report.page import CONTENTS, write_report

__all__ = ["CONTENTS", "write_report"]
