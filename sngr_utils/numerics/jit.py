"""Compile a function on its first use, and keep the machine code between runs.

numba keeps machine code file by file, and does not notice when a function of another file that
was compiled into it has changed. So the folder it keeps it in is named after the sources of all
compiled modules: an edit to any of them compiles all of them again.

What is compiled moves rows and blocks number by number. An array that is assigned to a part of
another one brings numba's message for shapes that do not fit along, twice the code of most
functions here, and into all that call them.
"""

import hashlib
import warnings
from pathlib import Path

import numba
import numba.extending

from sngr_utils import paths


def fingerprint(package: Path) -> str:
    """Hash of the sources in a folder that compile anything, wherever below it they lie."""
    sources = [path.read_bytes() for path in package.rglob("*.py")]
    compiled = sorted(source for source in sources if b"compile_once" in source)
    return hashlib.sha256(b"\0".join(compiled)).hexdigest()[:16]


numba.config.CACHE_DIR = str(paths.BUILD / "cache" / "numba" / fingerprint(paths.PACKAGE))

if numba.config.DISABLE_JIT:
    warnings.warn(
        "NUMBA_DISABLE_JIT is set: nothing is compiled, all takes far longer", stacklevel=2
    )

# Loops here run over three, or over a handful: in copies for four at a time they are no quicker,
# and take a fifth more time to compile.
numba.config.LOOP_VECTORIZE = 0

# No Python objects inside, so threads run in parallel; x / 0 is inf, as in NumPy; nothing is
# called from C, whose wrappers are a seventh of the time that compiling takes.
OPTIONS = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
compile_once = numba.njit(cache=True, **OPTIONS)

# Python where Python calls it, with arrays too; compiled into what is compiled.
also_compile_once = numba.extending.register_jitable
