"""What a process that user's code starts by `spawn` or `forkserver` runs first, as the `__main__` of its parent.

With it, that process finds the user's modules in their frozen copy.
"""

from __future__ import annotations

import resim.core.plugins.loading  # noqa: F401
