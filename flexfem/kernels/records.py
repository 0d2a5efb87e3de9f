# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records: named arrays and numbers that compiled loops take as one argument.

A call of a compiled loop costs some 35 ns for each array argument, and every function that passes
arrays on is compiled with seven machine words for each of them. A record is passed as the address
of a block of memory with the addresses and shapes of its arrays: one argument for any number of
arrays, from Python as well as between loops.

A class derived from :class:`Record` lists the fields; in a loop :func:`unpack` returns its fields::

    class Bars(Record):
        nodes: Int2D  # (m, 2) nodes of each bar
        stiffness: Float1D  # (m,) N/m

    @kernel
    def total(bars: Memory) -> float:
        own = unpack(Bars, bars)
        return own.stiffness[own.nodes[:, 0]].sum()

    bars = Bars(nodes=..., stiffness=...)
    total(bars.memory)

A record keeps references to its arrays. Loops see changes of their entries, and another array that
is assigned to a field.
"""

from types import SimpleNamespace
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    dataclass_transform,
    get_type_hints,
)

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import impl_ret_borrowed, lower_constant, lower_getattr_generic
from numba.core.typing.templates import (
    AttributeTemplate,
    infer,
    infer_getattr,
    infer_global,
    make_intrinsic_template,
)
from numba.extending import models, register_model, typeof_impl
from numba.np.arrayobj import make_array, populate_array

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray

__all__ = [
    "Bool1D",
    "Bool2D",
    "Float1D",
    "Float2D",
    "Float3D",
    "Float4D",
    "Float5D",
    "Index1D",
    "Index2D",
    "Int1D",
    "Int2D",
    "Int3D",
    "Memory",
    "Record",
    "array_at",
    "unpack",
]

#: Memory of a record, the argument of a loop.
Memory = IntArray


class _Layout(NamedTuple):
    """Scalar type, and number of axes: 0 for a number."""

    scalar: np.dtype[Any]
    axes: int

    @property
    def words(self) -> int:
        """Machine words in the memory of a record: address and shape, or the number."""
        return 1 + self.axes


def _layout(scalar: Any, axes: int) -> _Layout:
    return _Layout(np.dtype(scalar), axes)


Float1D = Annotated[FloatArray, _layout(np.float64, 1)]
Float2D = Annotated[FloatArray, _layout(np.float64, 2)]
Float3D = Annotated[FloatArray, _layout(np.float64, 3)]
Float4D = Annotated[FloatArray, _layout(np.float64, 4)]
Float5D = Annotated[FloatArray, _layout(np.float64, 5)]
Int1D = Annotated[IntArray, _layout(np.int64, 1)]
Int2D = Annotated[IntArray, _layout(np.int64, 2)]
Int3D = Annotated[IntArray, _layout(np.int64, 3)]
#: Nodes and cells of DOLFINx.
Index1D = Annotated[IndexArray, _layout(np.int32, 1)]
Index2D = Annotated[IndexArray, _layout(np.int32, 2)]
Bool1D = Annotated[BoolArray, _layout(np.bool_, 1)]
Bool2D = Annotated[BoolArray, _layout(np.bool_, 2)]

_NUMBERS = {float: _layout(np.float64, 0), int: _layout(np.int64, 0), bool: _layout(np.int64, 0)}


@dataclass_transform(kw_only_default=True)
class _RecordClass(type):
    """Metaclass of records, with the position of each field in the memory."""

    _fields: dict[str, tuple[int, _Layout]] | None = None

    def word(cls, name: str) -> int:
        """First word of a field, see :func:`array_at`."""
        return cls.fields[name][0]

    @property
    def fields(cls) -> dict[str, tuple[int, _Layout]]:
        """First word and layout of each field."""
        if cls._fields is None:
            found, at = {}, 0
            for name, hint in get_type_hints(cls, include_extras=True).items():
                if getattr(hint, "__origin__", None) is not ClassVar:
                    layout = _NUMBERS.get(hint) or hint.__metadata__[0]
                    found[name] = at, layout
                    at += layout.words
            cls._fields = found
        return cls._fields


class _Words(bytearray):
    """Memory of a record, which keeps its arrays alive."""

    fields: dict[str, Any]


class Record(metaclass=_RecordClass):
    """Named arrays, C-contiguous, and numbers; see the module.

    Attributes:
        memory: argument for loops.
    """

    __slots__ = ("__dict__", "memory")
    if TYPE_CHECKING:
        memory: ClassVar[Memory]

    def __init__(self, **values: Any) -> None:
        """Store the fields.

        Raises:
            TypeError: a field is missing or unknown, or an array has another layout.
        """
        fields = type(self).fields
        if values.keys() != fields.keys():
            odd = ", ".join(sorted(values.keys() ^ fields.keys()))
            raise TypeError(f"{type(self).__name__}: missing or unknown fields: {odd}")
        words = _Words(8 * sum(layout.words for _, layout in fields.values()))
        words.fields = self.__dict__
        object.__setattr__(self, "memory", np.frombuffer(words, dtype=np.int64))
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        """Assign another array or number to a field.

        Raises:
            TypeError: it has another layout than the field, or there is no such field.
        """
        if name not in type(self).fields:
            raise TypeError(f"{type(self).__name__} has no field {name}")
        if self.__dict__.get(name) is value:
            return
        at, (scalar, axes) = type(self).fields[name]
        if axes == 0:
            self.memory[at : at + 1].view(scalar)[0] = value
        elif isinstance(value, np.ndarray) and (value.dtype, value.ndim) == (scalar, axes):
            if not value.flags.c_contiguous:
                raise TypeError(f"{type(self).__name__}.{name}: the array is not contiguous")
            self.memory[at] = value.ctypes.data
            self.memory[at + 1 : at + 1 + axes] = value.shape
        else:
            raise TypeError(f"{type(self).__name__}.{name} takes an array {scalar}, {axes}d")
        object.__setattr__(self, name, value)


def unpack[R: Record](kind: type[R], memory: Memory) -> R:
    """The record at a memory, for compiled loops.

    Args:
        kind: class of the record.
        memory: that of a record of this class, which is not checked.
    """
    plain: Any = SimpleNamespace(**memory.base.obj.fields)  # type: ignore[union-attr]
    return plain  # type: ignore[no-any-return]


class _KindType(types.Opaque):
    """Numba's type of a class of records."""

    def __init__(self, kind: _RecordClass) -> None:
        super().__init__(f"Record[{kind.__module__}.{kind.__qualname__}]")
        self.kind = kind


class _RecordType(types.Type):
    """Numba's type of a record: a pointer to its memory."""

    def __init__(self, kind: _RecordClass) -> None:
        super().__init__(f"{kind.__module__}.{kind.__qualname__}")
        self.kind = kind


register_model(_KindType)(models.OpaqueModel)


@register_model(_RecordType)
class _RecordModel(models.PrimitiveModel):
    """Data model of a record."""

    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64).as_pointer())


@typeof_impl.register(_RecordClass)
def _type_of_kind(value: _RecordClass, context: Any) -> _KindType:
    return _KindType(value)


@lower_constant(_KindType)
def _constant_kind(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


def _unpack(typingctx: Any, kind: Any, memory: Any) -> Any:
    """Type and code of :func:`unpack`."""
    if not isinstance(kind, _KindType) or memory != types.Array(types.int64, 1, "C"):
        return None

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return make_array(signature.args[1])(context, builder, arguments[1]).data

    return _RecordType(kind.kind)(kind, memory), codegen


def array_at(memory: Memory, word: int) -> FloatArray:
    """The array with two axes whose field begins at a word of a record, for compiled loops.

    Args:
        memory: of a record.
        word: result of :meth:`Record.word`, an argument of loops for several kinds of records.
    """
    raise NotImplementedError("only compiled loops find arrays so")


def _array_at(typingctx: Any, memory: Any, word: Any) -> Any:
    """Type and code of :func:`array_at`."""
    layout = _layout(np.float64, 2)

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        words = make_array(signature.args[0])(context, builder, arguments[0]).data
        return _array(context, builder, builder.gep(words, [arguments[1]]), layout)

    return _field_type(layout)(memory, types.intp), codegen


for _function, _definition in ((unpack, _unpack), (array_at, _array_at)):
    _template = make_intrinsic_template(_function, _definition, _function.__name__)
    infer(_template)
    infer_global(_function, types.Function(_template))


def _field_type(layout: _Layout) -> Any:
    """Numba's type of a field."""
    scalar = types.boolean if layout.scalar == np.bool_ else getattr(types, layout.scalar.name)
    return types.Array(scalar, layout.axes, "C") if layout.axes else scalar


@infer_getattr
class _Fields(AttributeTemplate):
    """Types of the fields of a record."""

    key = _RecordType

    def generic_resolve(self, record: Any, name: str) -> Any:  # type: ignore[override]
        """Type of one field, None if there is no such field."""
        found = record.kind.fields.get(name)
        return None if found is None else _field_type(found[1])


@lower_getattr_generic(_RecordType)
def _load_field(context: Any, builder: Any, record: Any, value: Any, name: str) -> Any:
    """Code that reads one field."""
    at, layout = record.kind.fields[name]
    words = cgutils.gep_inbounds(builder, value, at)
    if layout.axes:
        array = _array(context, builder, words, layout)
        return impl_ret_borrowed(context, builder, _field_type(layout), array)
    number = _word(builder, words, 0)
    if layout.scalar == np.float64:
        return builder.bitcast(number, ir.DoubleType())
    return number


def _word(builder: Any, words: Any, k: int) -> Any:
    """Code that reads a word; no loop changes the memory of a record."""
    load = builder.load(cgutils.gep_inbounds(builder, words, k))
    load.set_metadata("invariant.load", builder.module.add_metadata([]))
    return load


def _array(context: Any, builder: Any, words: Any, layout: _Layout) -> Any:
    """Code that makes an array of its address and shape."""
    kind = _field_type(layout)
    array = make_array(kind)(context, builder)
    size = context.get_constant(types.intp, layout.scalar.itemsize)
    shape, strides = [_word(builder, words, 1 + k) for k in range(layout.axes)], [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    pointer = context.get_data_type(kind.dtype).as_pointer()
    data = builder.inttoptr(_word(builder, words, 0), pointer)
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()
