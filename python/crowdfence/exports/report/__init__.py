"""A run as one page that can be read anywhere, printed, and sent by mail."""

from crowdfence.exports.report.page import report_page

__all__ = ["report_page"]
