"""Ask for a row of an array before it is needed, so that several waits for memory overlap."""

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

_READ, _KEEP, _DATA = 0, 3, 1  # arguments of llvm.prefetch


@intrinsic
def fetch(typing, rows, i):
    """Begin to load the first cache line of rows[i]; no effect but on time."""

    def code(context, builder, signature, args):
        array = context.make_array(signature.args[0])(context, builder, args[0])
        i = context.cast(builder, args[1], signature.args[1], types.intp)
        step = builder.mul(builder.extract_value(array.strides, 0), i)
        base = builder.ptrtoint(array.data, ir.IntType(64))
        line = builder.inttoptr(builder.add(base, step), ir.IntType(8).as_pointer())
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [line.type, number, number, number])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(prefetch, [line, number(_READ), number(_KEEP), number(_DATA)])
        return context.get_dummy_value()

    return types.none(rows, i), code
