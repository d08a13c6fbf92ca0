"""How the engine's inner functions are compiled: once each, and most of them without a way in from Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit, types


def compiled(function: Callable[..., Any], from_python: bool = False) -> Any:
    """
    Numba compiles a function anew for every kind of its arguments, of which 0, 1, an int8 and an int64 are four. Here all
    signed integers are int64. That, and no wrapper for calls from Python, halves the time that the engine takes to compile.

    :param function: that allocates no memory (kernel.py)
    :param from_python: whether Python calls it too
    """
    dispatcher = njit(no_cpython_wrapper=not from_python, no_cfunc_wrapper=True, _nrt=False)(function)
    template_of = dispatcher.get_call_template
    dispatcher.get_call_template = lambda args, kws: template_of(
        tuple(map(_widened, args)), {name: _widened(kind) for name, kind in dict(kws).items()}
    )
    return dispatcher


def compiled_for_python(function: Callable[..., Any]) -> Any:
    """See :func:`compiled`, of a function that Python calls too."""
    return compiled(function, from_python=True)


def _widened(kind: Any) -> Any:
    """:return: numba's type of an argument, without its value and with 64 bits, within tuples too"""
    kind = types.unliteral(kind)
    if isinstance(kind, types.Integer) and kind.signed:
        return types.int64
    if isinstance(kind, types.Tuple | types.UniTuple):
        return types.Tuple([_widened(part) for part in kind])
    return kind
