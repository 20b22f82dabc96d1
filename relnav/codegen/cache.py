"""Is the compiled code of this very version at hand: asked before numba is imported, which costs half a second."""

import hashlib
import os
from pathlib import Path

LAST_COMPILED = "log._run-*.nbi"
"""Index of the log loop: it is compiled after everything that it calls."""


def package_stamp() -> str:
    """Digest of every source file of the package, about 5 ms."""
    root = Path(__file__).resolve().parent.parent
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def compiled_code_at_hand() -> bool:
    """Whether the log loop is in one of numba's cache folders, under the stamp of this package's content."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    shared = [Path(os.environ["NUMBA_CACHE_DIR"])] if os.environ.get("NUMBA_CACHE_DIR") else []
    found = list((Path(__file__).resolve().parent.parent / "navigation" / "__pycache__").glob(LAST_COMPILED))
    for folder in (*shared, home):
        found.extend(folder.glob(f"*/{LAST_COMPILED}"))
    stamp = package_stamp().encode()
    return any(stamp in path.read_bytes() for path in found)
