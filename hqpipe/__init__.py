"""hqpipe: close the sim-to-real gap of heavy hydraulic legged robots."""

from __future__ import annotations

from hqpipe.system.kernel_cache import set_folder

__version__ = "0.1.0"

set_folder()
