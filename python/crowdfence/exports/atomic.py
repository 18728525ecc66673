"""Where the compiled core looks for `write_bytes`."""  # until the binding is mended

from crowdfence.atomic_file import write_bytes

__all__ = ["write_bytes"]
