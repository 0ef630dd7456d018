"""How the kernel's functions are compiled, and what keeps numba from counting references in their loops."""

# mypy: ignore-errors
from __future__ import annotations

from numba import njit
from numba.core import cgutils
from numba.core.extending import intrinsic

compiled = njit(error_model="numpy")
"""Division by zero gives what the processor gives, as in numpy."""

inlined = njit(error_model="numpy", forceinline=True)
"""The same, for what stands inside of loops: a call there keeps them from becoming vector operations."""


@intrinsic
def borrowed(typing, array):
    """Give an array without its owner: nobody counts references to it (half of the time before).

    Whoever calls this must hold the array itself for as long as what he gets is in use.
    """

    def codegen(context, builder, signature, arguments):
        view = cgutils.create_struct_proxy(signature.args[0])(context, builder, value=arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), codegen
