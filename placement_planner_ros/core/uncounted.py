"""Kernels that count no references to the arrays that they are given."""

from __future__ import annotations

from typing import Any

from numba.core.compiler import CompilerBase, DefaultPassBuilder


class Uncounted(CompilerBase):
    """Numba's pipeline, for kernels that make no array, not even for a while.

    Arrays that are handed to a kernel belong to its caller, yet numba counts a reference to each of
    them, those within tuples too, at each call of a kernel by another: with the tuples of the
    collision check that takes several times as long as the check.
    """

    def define_pipelines(self) -> list[Any]:
        """The one without counts."""
        self.state.targetctx = self.state.targetctx.subtarget(enable_nrt=False)
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]
