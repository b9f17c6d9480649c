"""A device made of Python, ``"apart"``: its tensors are no memory of the host, as those of a GPU, and none is needed.

What takes a tensor there for an array of NumPy raises, and so does an operator between it and a tensor of the host. The
numbers are held by a tensor of the host that nobody else sees. Fused operators run in their form for the CPU.

Importing this registers the device for the whole process: ``test_apart.py`` starts one for it.
"""

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map
from torch.utils.backend_registration import _DummyBackendModule, _setup_privateuseone_for_python_backend

torch.inference_mode = torch.no_grad  # whose tensors have no versions, which such a tensor must have

_BOTH = ("aten::copy_", "aten::_to_copy", "aten::index")  # operators that may read tensors of two devices


class _Module(_DummyBackendModule):
    """What torch asks of ``torch.apart``."""

    def get_amp_supported_dtype(self):
        return [torch.bfloat16]


_setup_privateuseone_for_python_backend("apart", backend_module=_Module())


class Apart(torch.Tensor):
    """A tensor on the device."""

    @staticmethod
    def __new__(cls, held):
        return torch.Tensor._make_wrapper_subclass(
            cls, held.shape, strides=held.stride(), storage_offset=held.storage_offset(), dtype=held.dtype,
            device=torch.device("apart:0"), requires_grad=False,
        )  # fmt: skip

    def __init__(self, held):
        self.held = held

    def tolist(self):
        return self.held.tolist()

    def __repr__(self):
        return f"Apart({self.held})"

    @classmethod
    def __torch_dispatch__(cls, operator, types, args=(), kwargs=None):
        return _run(operator, args, kwargs or {})


class OnApart(TorchDispatchMode):
    """While this lasts, tensors can be made on the device."""

    def __torch_dispatch__(self, operator, types, args=(), kwargs=None):
        return _run(operator, args, kwargs or {})


def _on_host(value):
    if isinstance(value, Apart):
        return value.held
    return torch.device("cpu") if isinstance(value, torch.device) and value.type == "apart" else value


def _run(operator, args, kwargs):
    name, asked = operator.name(), kwargs.get("device")
    tensors = [value for value in tree_leaves((args, kwargs)) if isinstance(value, torch.Tensor)]
    own = [value for value in tensors if isinstance(value, Apart)]
    strange = [value for value in tensors if not isinstance(value, Apart) and value.ndim]
    if own and strange and not name.startswith(_BOTH):
        raise RuntimeError(f"{name}: expected all tensors to be on the same device, but found apart and cpu")
    result = operator(*tree_map(_on_host, args), **tree_map(_on_host, kwargs))
    if name == "aten::copy_":
        return args[0]
    if not (own if asked is None else torch.device(asked).type == "apart"):
        return result
    known = {id(value.held): value for value in own}  # what works in place hands on the tensor itself

    def named(value):
        if not isinstance(value, torch.Tensor):
            return value
        return known[id(value)] if id(value) in known else Apart(value.resolve_conj().resolve_neg())

    return tree_map(named, result)


def _copied(source, target, non_blocking=False):
    _on_host(target).copy_(_on_host(source))
    return target


# Below the operators that Python sees, torch moves the lists of an index to the device by these.
_LIBRARY = torch.library.Library("aten", "IMPL")
_LIBRARY.impl("empty_strided", lambda *shape, dtype=None, **_: Apart(torch.empty_strided(*shape, dtype=dtype)),
              "PrivateUse1")  # fmt: skip
_LIBRARY.impl("empty.memory_format", lambda *shape, dtype=None, **_: Apart(torch.empty(*shape, dtype=dtype)),
              "PrivateUse1")  # fmt: skip
_LIBRARY.impl("_copy_from", _copied, "PrivateUse1")
