"""Pendulums side by side, as the compiled code sees them: `b[field, j]` is a number of pendulum j.

To numba an array of two axes would do as well, but for two things: how far its fields lie apart is known when the code
runs only, so that nothing vectorises, and an access costs three times as much to compile, of which the step has some
hundred. So this is a type of its own: an address, whose width, the distance between fields, is part of the type.
"""

from __future__ import annotations

import ctypes
import operator
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from spring_pendulum_env.jit import DISABLED
from spring_pendulum_env.layout import FIELDS, WIDTH

NUMBER = types.float64
POINTER = types.CPointer(NUMBER)


class Lanes(types.CPointer):
    """The type: `width` pendulums side by side, one field after the other."""

    def __init__(self, width: int) -> None:
        super().__init__(NUMBER)
        self.width = width
        self.name = f"Lanes({width})"

    @property
    def key(self) -> int:
        """What tells one such type from another."""
        return self.width


register_model(Lanes)(models.PointerModel)


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002
        if isinstance(args[0], Lanes) and isinstance(args[1], types.BaseTuple):
            return signature(NUMBER, *args)
        return None


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002
        if isinstance(args[0], Lanes) and isinstance(args[1], types.BaseTuple):
            return signature(types.none, args[0], args[1], NUMBER)
        return None


def _place(context: Any, builder: Any, lanes: Lanes, address: Any, index_type: Any, index: Any) -> Any:
    """The address of a number."""
    field, lane = cgutils.unpack_tuple(builder, index)
    field = context.cast(builder, field, index_type[0], types.intp)
    lane = context.cast(builder, lane, index_type[1], types.intp)
    width = context.get_constant(types.intp, lanes.width)
    return builder.gep(address, [builder.add(builder.mul(field, width), lane)])


@lower_builtin(operator.getitem, Lanes, types.BaseTuple)
def _get(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    lanes, index_type = signature.args
    address, index = arguments
    return builder.load(_place(context, builder, lanes, address, index_type, index))


@lower_builtin(operator.setitem, Lanes, types.BaseTuple, types.float64)
def _set(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    lanes, index_type, _ = signature.args
    address, index, number = arguments
    builder.store(number, _place(context, builder, lanes, address, index_type, index))


def _pointer_to(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    """An address that is a float64, as a pointer."""
    number = builder.fptoui(address, context.get_value_type(types.uintp))
    return builder.inttoptr(number, context.get_value_type(kind))


def _floats_at(_typing: Any, _address: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _pointer_to(context, builder, POINTER, arguments[0])

    return POINTER(NUMBER), generate


def _one_at(_typing: Any, _address: Any) -> Any:
    one = Lanes(1)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return _pointer_to(context, builder, one, arguments[0])

    return one(NUMBER), generate


def _many_in(_typing: Any, buffer: Any) -> Any:
    many = Lanes(WIDTH)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.bitcast(array.data, context.get_value_type(many))

    return many(buffer), generate


def _keep(_typing: Any, array: Any) -> Any:
    return types.none(array), lambda context, *_: context.get_dummy_value()


def _block_of(_typing: Any, rows: Any, _number: Any) -> Any:
    many = Lanes(WIDTH)

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        size = context.get_constant(types.intp, FIELDS * WIDTH)
        block = builder.gep(arguments[0], [builder.mul(arguments[1], size)])
        return builder.bitcast(block, context.get_value_type(many))

    return many(rows, types.intp), generate


def _flat(_typing: Any, b: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], context.get_value_type(POINTER))

    return POINTER(b), generate


def _numbers_from(_typing: Any, source: Any, _first: Any) -> Any:
    kind = types.uint8 if source.dtype == types.boolean else source.dtype  # of which numba has no pointers

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = arguments[0]
        if isinstance(source, types.Array):
            data = context.make_array(signature.args[0])(context, builder, data).data
        return builder.gep(data, [arguments[1]])

    return types.CPointer(kind)(source, types.intp), generate


def _put_side_by_side(_typing: Any, b: Any, _fields: Any, _lane: Any, to: Any, _pitch: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        lanes, fields, lane, to, pitch = arguments
        kind = ir.VectorType(ir.DoubleType(), 4)

        def shuffled(one: Any, other: Any, *which: int) -> Any:
            return builder.shuffle_vector(one, other, ir.Constant(ir.VectorType(ir.IntType(32), 4), which))

        across = []
        for field in cgutils.unpack_tuple(builder, fields):
            width = context.get_constant(types.intp, b.width)
            address = builder.gep(lanes, [builder.add(builder.mul(field, width), lane)])
            across.append(builder.load(builder.bitcast(address, kind.as_pointer()), align=8))
        # Pairs of fields are interleaved, then pairs of pairs: a matrix of four by four is transposed.
        low1, high1 = shuffled(across[0], across[1], 0, 4, 2, 6), shuffled(across[0], across[1], 1, 5, 3, 7)
        low2, high2 = shuffled(across[2], across[3], 0, 4, 2, 6), shuffled(across[2], across[3], 1, 5, 3, 7)
        along = [
            shuffled(low1, low2, 0, 1, 4, 5),
            shuffled(high1, high2, 0, 1, 4, 5),
            shuffled(low1, low2, 2, 3, 6, 7),
            shuffled(high1, high2, 2, 3, 6, 7),
        ]
        for number, row in enumerate(along):
            address = builder.gep(to, [builder.mul(pitch, context.get_constant(types.intp, number))])
            builder.store(row, builder.bitcast(address, kind.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.none(b, types.UniTuple(types.intp, 4), types.intp, to, types.intp), generate


def _in_use(_typing: Any, b: Any, lanes: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if b.width == 1:
            return context.get_constant(types.intp, 1)
        count = context.cast(builder, arguments[1], signature.args[1], types.intp)
        return builder.and_(count, context.get_constant(types.intp, -4))

    return types.intp(b, lanes), generate


class _Plain:
    """The same in plain Python, where nothing is compiled."""

    @staticmethod
    def floats_at(address: float) -> Any:
        return ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))

    @staticmethod
    def one_at(address: float) -> Any:
        from spring_pendulum_env.layout import CELL

        return np.ctypeslib.as_array(_Plain.floats_at(address), (CELL, 1))

    @staticmethod
    def many_in(buffer: Any) -> Any:
        return buffer

    @staticmethod
    def keep(_array: Any) -> None:
        pass

    @staticmethod
    def block_of(rows: Any, number: int) -> Any:
        size = FIELDS * WIDTH
        return rows[size * number : size * (number + 1)].reshape(FIELDS, WIDTH)

    @staticmethod
    def flat(b: Any) -> Any:
        return b.reshape(-1)

    @staticmethod
    def numbers_from(source: Any, first: int) -> Any:
        return source.reshape(-1)[first:]

    @staticmethod
    def put_side_by_side(b: Any, fields: tuple[int, ...], lane: int, to: Any, pitch: int) -> None:
        for number in range(4):
            to[pitch * number : pitch * number + 4] = b[list(fields), lane + number]

    @staticmethod
    def in_use(b: Any, lanes: int) -> int:
        return 1 if b.shape[1] == 1 else lanes & -4


floats_at: Any = _Plain.floats_at if DISABLED else intrinsic(_floats_at)
"""The numbers at an address. The address is a float, which holds all that a process can have: Python's float is handed
over faster than an int."""

one_at: Any = _Plain.one_at if DISABLED else intrinsic(_one_at)
"""The pendulum in the cell at an address."""

many_in: Any = _Plain.many_in if DISABLED else intrinsic(_many_in)
"""The pendulums in an array of shape (BUFFER, WIDTH), which must be kept as long as they are used ..."""

keep: Any = _Plain.keep if DISABLED else intrinsic(_keep)
"""... by this after their last use: compiled code lets go of an array after its own."""

numbers_from: Any = _Plain.numbers_from if DISABLED else intrinsic(_numbers_from)
"""The address of an array's numbers, or of those at another address, from the `first` on, one after the other. Nobody
looks whether a number is there, and none is counted from the end, which an access to an array would."""

block_of: Any = _Plain.block_of if DISABLED else intrinsic(_block_of)
"""The pendulums in a block of rows at an address, by the block's number."""

flat: Any = _Plain.flat if DISABLED else intrinsic(_flat)
"""All numbers of some lanes, one field after the other."""

put_side_by_side: Any = _Plain.put_side_by_side if DISABLED else intrinsic(_put_side_by_side)
"""Writes four fields of the four pendulums from `lane` on: one pendulum's side by side, those of the next `pitch`
numbers further on. Sixteen numbers are turned in registers, which the compiler doesn't find by itself."""

in_use: Any = _Plain.in_use if DISABLED else intrinsic(_in_use)
"""How many of the lanes are gone through: one, or a multiple of four, so that no loop has a remainder."""
