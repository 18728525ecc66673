"""Methods beside each other on one recording, as a page with plots (`crowdfence evaluate --report`)."""

from crowdfence.evaluation.report.page import CONTENTS, require_people, write_report

__all__ = ["CONTENTS", "require_people", "write_report"]
