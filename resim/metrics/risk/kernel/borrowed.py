"""What keeps numba from counting references in the kernel's loops."""

# mypy: ignore-errors
from __future__ import annotations

from numba import types
from numba.core import cgutils
from numba.core.extending import intrinsic


def _without_owner(context, builder, kind, value):
    """The value with no owner of the arrays in it."""
    if isinstance(kind, types.Array):
        view = cgutils.create_struct_proxy(kind)(context, builder, value=value)
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind.types):
            given = builder.extract_value(value, i)
            value = builder.insert_value(value, _without_owner(context, builder, part, given), i)
    return value


@intrinsic
def borrowed(typing, arrays):
    """Give an array, or a tuple with arrays, without owner: nobody counts references (half of the time before).

    Whoever calls this must hold the arrays themselves for as long as what he gets is in use.
    """

    def codegen(context, builder, signature, arguments):
        return _without_owner(context, builder, signature.args[0], arguments[0])

    return arrays(arrays), codegen
