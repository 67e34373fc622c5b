"""Build switches of the compiled core, all of them.

``BFRT_BUILD=release`` (the default), ``debug`` (bounds checks, line numbers for profilers) or
``sanitize`` (AddressSanitizer and UndefinedBehaviorSanitizer; run it under ``LD_PRELOAD`` of
libasan, as docs/building.rst shows).
"""

import gc
import os
import sys
from pathlib import Path

from Cython.Compiler import Errors
from setuptools import Extension, setup

BUILD = os.environ.get("BFRT_BUILD", "release")

# The same picture on every machine: no fused multiply-add, no fast-math. The two -fno options
# change no value: nobody reads errno or the floating-point flags.
EXACT = ["-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"]
FLAGS = {
    "release": ["-O3", "-g0"],  # Python's own -g makes modules three times as large
    "debug": ["-O1", "-g"],
    "sanitize": ["-O1", "-g", "-fsanitize=address,undefined", "-fno-omit-frame-pointer"],
}[BUILD]
LINK = ["-fsanitize=address,undefined"] if BUILD == "sanitize" else []
# What Cython adds to each module that has typed memoryviews is compiled once, for all of them.
SHARED = Path("bfrt/_cython.c")
# No conversion and no rendering waits for these, so that they are compiled in half the time.
COLD = {
    SHARED: "no loop of ours",
    Path("bfrt/reference"): "the slow twins, which tests compare with",
    Path("bfrt/spd"): "standard scenes, which are made as fast",
}
LESS = ["-O1"] if BUILD == "release" else []
CHECKED = BUILD == "debug"
DIRECTIVES = {
    "language_level": 3,
    "boundscheck": CHECKED,
    "wraparound": False,
    "initializedcheck": CHECKED,
    "cdivision": True,
    "freethreading_compatible": True,
    "auto_pickle": False,  # nothing compiled is sent anywhere
}


def refuse_performance_hint(position, message, env):
    """A hint means that a loop takes the GIL unasked, so it fails the build."""
    Errors.error(position, message)


Errors.performance_hint = refuse_performance_hint  # before the compiler's other modules load
from Cython.Build import cythonize  # noqa: E402


def is_cold(source):
    return not COLD.keys().isdisjoint([source, *source.parents])


def extension(source):
    return Extension(
        ".".join(source.with_suffix("").parts),
        [str(source)],
        extra_compile_args=FLAGS + EXACT + (LESS if is_cold(source) else []),
        extra_link_args=LINK,
        define_macros=[("CYTHON_USE_PEP489_MULTI_PHASE_INIT", "1")],
    )


def longest_first(modules):
    """Sort modules by how long the compiler takes, about: all cores then end at the same time."""
    return sorted(modules, key=lambda module: -Path(module.sources[0]).stat().st_size)


def modules():
    """Return the modules, translated to C; none where pip asks for nothing but metadata, twice."""
    if {"egg_info", "dist_info"} & set(sys.argv[1:]):
        return []
    gc.disable()  # what Cython makes stays until it ends: to look through it takes half its time
    return cythonize(
        [extension(SHARED), *map(extension, sorted(Path("bfrt").rglob("*.pyx")))],
        shared_utility_qualified_name=".".join(SHARED.with_suffix("").parts),
        build_dir="build/cython",
        compiler_directives=DIRECTIVES,
        nthreads=os.cpu_count() or 1,
    )


setup(
    ext_modules=longest_first(modules()),
    options={"build_ext": {"parallel": os.cpu_count() or 1}},
)
