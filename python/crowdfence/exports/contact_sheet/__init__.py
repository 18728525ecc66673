"""A recording at a glance: frames, their labels, and where they were taken."""

from crowdfence.exports.contact_sheet.sheet import write_contact_sheet

__all__ = ["write_contact_sheet"]
