"""An emulated GPU: its tensors hold real numbers on the CPU, but refuse to mix with the CPU's.

It is there within `with Machine():`. It fails where CUDA fails: an operation on tensors of two
devices (single numbers of the CPU may mix), `.numpy()` of a GPU's tensor, a CPU's random generator
for a GPU's numbers. CUDA also takes indices on the CPU; here they are refused, as each is a copy.
Operations compute the same bits as on the CPU.

PyTorch can register it once in a process, before the first backward pass: use it as a plugin,
`python -m pytest -p tests.emulated_gpu FILE`. The option device=cuda is then the emulated GPU.
"""

import torch
from torch import _VF
from torch.nn import functional
from torch.utils import backend_registration
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map, tree_map_only

from marl_cair.training.settings import checks

NAME = "emulated"
GPU = torch.device("privateuseone", 0)  # called NAME once it is registered
aten = torch.ops.aten


class GpuTensor(torch.Tensor):
    """A tensor of the emulated GPU, with its numbers in `held`."""

    @staticmethod
    def __new__(cls, held):
        about = {"strides": held.stride(), "storage_offset": held.storage_offset()}
        shape, kind = held.shape, held.dtype
        return cls._make_wrapper_subclass(cls, shape, dtype=kind, device=GPU, **about)

    def __init__(self, held):
        self.held = held

    def __repr__(self):
        return f"GpuTensor({self.held})"

    @classmethod
    def __torch_dispatch__(cls, function, types, args=(), kwargs=None):
        return compute(function, args, kwargs or {})


class Machine(TorchDispatchMode):
    """Makes tensors on the emulated GPU, and copies to and from it."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        return compute(function, args, kwargs or {})


def compute(function, args, kwargs):
    leaves = tree_leaves((args, kwargs))
    given = [leaf for leaf in leaves if isinstance(leaf, torch.Tensor)]
    is_here = any(isinstance(one, GpuTensor) for one in given)
    asked = None if kwargs.get("device") is None else torch.device(kwargs["device"]).type
    if function is aten._to_copy.default:
        return copy(args[0], is_here if asked is None else asked == NAME, kwargs)
    if asked == NAME:
        kwargs, is_here = {**kwargs, "device": torch.device("cpu")}, True
    if not is_here:
        return function(*args, **kwargs)
    if function is not aten.copy_.default:
        require_one_device(function, given, leaves)
    held = tree_map_only(GpuTensor, lambda one: one.held, (args, kwargs))
    results = function(*held[0], **held[1])
    if function is aten.copy_.default:  # between any two devices
        return args[0]
    changed = {id(one.held): one for one in given if isinstance(one, GpuTensor)}

    def place(result):
        if not isinstance(result, torch.Tensor):
            return result
        known = changed.get(id(result))
        return GpuTensor(result) if known is None else known

    return tree_map(place, results)


def copy(source, is_to_gpu, kwargs):
    held = source.held if isinstance(source, GpuTensor) else source
    kept = {name: value for name, value in kwargs.items() if name != "device"}
    made = aten._to_copy.default(held, **kept)
    return GpuTensor(made) if is_to_gpu else made


def require_one_device(function, given, leaves):
    for one in given:
        if not isinstance(one, GpuTensor) and one.ndim:
            raise RuntimeError(
                f"Expected all tensors to be on the same device, but {function} got one of shape "
                f"{list(one.shape)} on the CPU"
            )
    if any(isinstance(leaf, torch.Generator) for leaf in leaves):
        raise RuntimeError(f"{function}: the generator is on the CPU")


def lstm_cell(seen, states, *weights):
    """`torch.lstm_cell` in plain operations: its kernel for GPUs has no copy on the CPU."""
    (hidden, cell), (into, back, bias, back_bias) = states, weights
    gates = functional.linear(seen, into, bias) + functional.linear(hidden, back, back_bias)
    enter, keep, new, show = gates.chunk(4, 1)
    cell = keep.sigmoid() * cell + enter.sigmoid() * new.tanh()
    return show.sigmoid() * cell.tanh(), cell


def gru_cell(seen, hidden, into, back, bias, back_bias):
    """`torch.gru_cell` in plain operations."""
    given = functional.linear(seen, into, bias).chunk(3, 1)
    held = functional.linear(hidden, back, back_bias).chunk(3, 1)
    reset, keep = (given[0] + held[0]).sigmoid(), (given[1] + held[1]).sigmoid()
    new = (given[2] + reset * held[2]).tanh()
    return new + keep * (hidden - new)


class _Module(backend_registration._DummyBackendModule):
    def get_amp_supported_dtype(self):
        return [torch.bfloat16]


backend_registration._setup_privateuseone_for_python_backend(NAME, _Module())
# On CUDA `Module.to` keeps parameters and changes their data; here it swaps the tensors.
torch.__future__.set_swap_module_params_on_conversion(True)
torch.inference_mode = torch.no_grad  # there views of tensors from outside fail here
_VF.lstm_cell, _VF.gru_cell = lstm_cell, gru_cell
find_real = checks.find_device
checks.find_device = lambda name: GPU if name == "cuda" else find_real(name)
