"""
A second device where there is no accelerator: its tensors hold values, live apart from those of the CPU, and say that they are
on "meta", the only device of torch's that any machine has besides. It draws from a random stream of its own.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from typing import Any
from unittest.mock import patch

import torch as th
from torch.overrides import TorchFunctionMode
from torch.utils._mode_utils import no_dispatch
from torch.utils._python_dispatch import TorchDispatchMode

OTHER = th.device("meta")
MOVES = (th.ops.aten._to_copy.default, th.ops.aten.copy_.default)
FROM_PYTHON = (th.tensor, th.as_tensor)


class Elsewhere(th.Tensor):
    """
    A tensor on the other device.

    :param held: its values
    """

    held: th.Tensor

    @staticmethod
    def __new__(cls, held: th.Tensor) -> "Elsewhere":
        layout = {"strides": held.stride(), "storage_offset": held.storage_offset()}
        tensor = th.Tensor._make_wrapper_subclass(cls, held.shape, **layout, dtype=held.dtype, device=OTHER)
        tensor.held = held
        return tensor

    def __tensor_flatten__(self) -> tuple[list[str], None]:
        return ["held"], None  # by which torch knows how to move a module's weights

    @staticmethod
    def __tensor_unflatten__(inner: dict[str, th.Tensor], *_: Any) -> "Elsewhere":
        return Elsewhere(inner["held"])

    def __repr__(self) -> str:  # type: ignore[override]
        return f"Elsewhere({self.held!r})"

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.held.__reduce_ex__(protocol)  # files are read onto the CPU

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return compute(function, args, kwargs or {})


class OtherModule:
    """What ``torch.cuda`` is for CUDA: the device's random stream, and waiting for what it computes."""

    def __init__(self) -> None:
        self.generator = th.Generator()

    def get_rng_state(self, device: th.device = OTHER) -> th.Tensor:
        """:return: the state of the device's random stream"""
        return self.generator.get_state()

    def set_rng_state(self, state: th.Tensor, device: th.device = OTHER) -> None:
        """
        :param state: of the device's random stream
        """
        self.generator.set_state(state)

    def manual_seed(self, seed: int) -> th.Generator:
        """
        Seed the CPU's stream too, as ``torch.manual_seed`` does.

        :param seed: of both
        :return: the CPU's generator
        """
        self.generator.manual_seed(seed)
        return th.default_generator.manual_seed(seed)

    def synchronize(self) -> None:
        """Nothing is computed later than it was asked for."""

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """Draw from the device's random stream instead of the CPU's."""
        of_cpu = th.get_rng_state()
        th.set_rng_state(self.get_rng_state())
        try:
            yield
        finally:
            self.set_rng_state(th.get_rng_state())
            th.set_rng_state(of_cpu)


def compute(function: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """
    :return: what an operation gives, computed on the CPU, on the device where it belongs
    :raises RuntimeError: if it gets tensors, or a generator, of another device than its own, as accelerators do
    """
    there: list[Elsewhere] = []
    here: list[th.Tensor] = []

    def values(tensor: th.Tensor) -> th.Tensor:
        if isinstance(tensor, Elsewhere):
            there.append(tensor)
            return tensor.held
        here.append(tensor)
        return tensor

    held_args, held_kwargs = changed(args, values), {name: changed(value, values) for name, value in kwargs.items()}
    device = kwargs.get("device")
    goes = bool(there) if device is None else device == OTHER
    if function not in MOVES and there and any(each.dim() for each in here):
        raise RuntimeError(f"{function}: expected all tensors to be on the same device")
    if goes and kwargs.get("generator") is not None:
        raise RuntimeError(f"{function}: expected a generator of the same device")
    draws = goes and th.Tag.nondeterministic_seeded in function.tags
    with th.meta.drawing() if draws else nullcontext():  # type: ignore[attr-defined]
        result = function(*held_args, **{**held_kwargs, **({} if device is None else {"device": "cpu"})})
    if function is th.ops.aten.copy_.default:
        return args[0]
    if not goes:
        return result
    if th.Tag.inplace_view in function.tags:
        with no_dispatch():
            function(*args, **kwargs)  # the tensor that holds the values gets their new shape, too
    same = {id(each.held): each for each in there}  # what was changed in place
    return changed(result, lambda each: same[id(each)] if id(each) in same else Elsewhere(each))


def changed(parts: Any, change: Callable[[th.Tensor], th.Tensor]) -> Any:
    """:return: the same, in which each tensor, also in lists and tuples, was changed; torch's own trees take far longer"""
    if isinstance(parts, th.Tensor):
        return change(parts)
    return type(parts)(changed(each, change) for each in parts) if isinstance(parts, list | tuple) else parts


class Computing(TorchDispatchMode):
    """Operations that make tensors of nothing come by here, too."""

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return compute(function, args, kwargs or {})


class Making(TorchFunctionMode):
    """Tensors of Python's and numpy's values are made on the CPU and moved."""

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        if function in FROM_PYTHON and kwargs.get("device") is not None:
            return function(*args, **{**kwargs, "device": "cpu"}).to(kwargs["device"])
        return function(*args, **kwargs)


@contextmanager
def other_device() -> Iterator[th.device]:
    """:return: the other device, while it is there"""
    module = OtherModule()
    with (
        patch.object(th, OTHER.type, module, create=True),
        patch.object(th, "manual_seed", module.manual_seed),
        Making(),
        Computing(),
    ):
        yield OTHER
