"""Toolchains: compilers that are fetched, pinned and called the same way everywhere.

In: C sources and flags. Out: shared libraries, objects, or a CompileError in the compiler's own words.

`compiler` calls Clang from pip's `ziglang`, for this machine and others, and names the cache folder. `sdcc`
calls SDCC for the Rabbit 4000. `debian` unpacks programs of Debian's packages into the cache.
"""
