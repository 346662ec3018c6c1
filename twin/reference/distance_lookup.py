"""The search of `distance_bounds` as machine code: balls of one surface looked up in the distance grid of the other.

One call handles many items; an item is a pair of shapes in a state. The balls of a shape are in the order of a
depth-first search. Each ball has the index of the first ball after its own smaller balls. The search therefore requires
no stack: it continues with the next ball, or skips the smaller balls of a ball. `_LookupKernel` writes this search:
    each
comment is the name of the block of machine code, and of the method that writes it.

    for each item:                                                          # next_item
        pose of the balls in the grid, limits of the search                 # read_item
        low = high = infinity
        n = first ball
        while n <= last ball and high >= reject:                            # next_ball
            stored = distance that the grid stores at the node nearest to the centre of ball n
            offset = distance of the centre from this node
            lower = max(stored - offset, distance of the centre from the box of the other surface)
            if lower - radius >= min(low, enough, share * high):            # bound_ball
                low = min(low, lower - radius)
                n = first ball after the smaller balls of n                 # skip_ball
                continue
            high = min(high, stored + offset + radius + error)              # bound_above
            if n has no smaller balls, or radius <= smallest_radius:
                lower, high = the best of these bounds at the eight nodes around the centre, too
                low = min(low, lower - radius)
                n = first ball after the smaller balls of n                 # refine
            else:
                n = n + 1, the first of the smaller balls of n              # descend
        store 0 if high < reject else max(low, 0), and high                 # store_bounds

`tests/reference/test_distance_bounds.py` compares the bounds with distances of surfaces.
"""

from __future__ import annotations

import ctypes
from functools import cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir

from twin.core.machine_code import compiled
from twin.core.spatial import Array

if TYPE_CHECKING:
    from _ctypes import CFuncPtr

BALL = 5
"""Count of numbers that describe a ball: centre (3), radius, index of the first ball after its smaller balls."""

GRID = 20
"""Count of numbers that describe a grid: first node (3), cell, 1/cell, index of the last node (3), strides (2), index
of the first value, box of the surface (6), near_error, accurate_below, far_error (see
`distance_bounds.DistanceGrid`)."""

PAIR = 6
"""Count of numbers that describe a pair: count of all shapes, then five indices: shape with the grid, shape with the
balls, grid, first ball, last ball + 1."""

_SUFFICIENT_SHARE = 0.75
"""In a search, a lower bound is sufficient if it is at least this fraction of the upper bound."""

_DOUBLE = ir.DoubleType()
_FLOAT = ir.FloatType()
_INT = ir.IntType(64)
_POINTER = ir.PointerType()


class _ExpressionWriter:
    """Writes expressions of doubles; a thin layer over llvmlite's builder."""

    def __init__(self, builder: ir.IRBuilder, module: ir.Module) -> None:
        self.b: Any = builder  # llvmlite does not state what its methods return
        self._module = module

    def intrinsic(self, name: str, *values: ir.Value) -> ir.Value:
        kind = ir.FunctionType(_DOUBLE, [_DOUBLE] * len(values))
        full_name = f"llvm.{name}.f64"
        function = self._module.globals.get(full_name)
        if function is None:
            function = ir.Function(self._module, kind, full_name)
        return self.b.call(function, values)

    def least(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.intrinsic("minnum", a, b)

    def most(self, a: ir.Value, b: ir.Value) -> ir.Value:
        return self.intrinsic("maxnum", a, b)

    def at(self, pointer: ir.Value, index: ir.Value | int, kind: ir.Type = _DOUBLE) -> ir.Value:
        if isinstance(index, int):
            index = ir.Constant(_INT, index)
        place = self.b.gep(pointer, [index], source_etype=kind)
        return self.b.load(place, typ=kind)

    def difference(self, a: list[ir.Value], b: list[ir.Value]) -> list[ir.Value]:
        differences = []
        for x, y in zip(a, b, strict=True):
            differences.append(self.b.fsub(x, y))
        return differences

    def matrix(self, pointer: ir.Value) -> list[list[ir.Value]]:
        """Return the first three rows of the pose (4, 4) at `pointer`."""
        numbers = self.numbers(pointer, 12)
        return [numbers[:4], numbers[4:8], numbers[8:]]

    def numbers(self, pointer: ir.Value, count: int, kind: ir.Type = _DOUBLE) -> list[ir.Value]:
        return [self.at(pointer, k, kind) for k in range(count)]

    def shifted(self, pointer: ir.Value, index: ir.Value, size: int, kind: ir.Type = _DOUBLE) -> ir.Value:
        offset = self.b.mul(index, ir.Constant(_INT, size))
        return self.b.gep(pointer, [offset], source_etype=kind)

    def dot(self, a: list[ir.Value], b: list[ir.Value]) -> ir.Value:
        total = self.b.fmul(a[0], b[0])
        for x, y in zip(a[1:], b[1:], strict=True):
            total = self.b.fadd(total, self.b.fmul(x, y))
        return total

    def size(self, v: list[ir.Value]) -> ir.Value:
        return self.intrinsic("sqrt", self.dot(v, v))


def _column(rows: list[list[ir.Value]], c: int) -> list[ir.Value]:
    return [row[c] for row in rows]


def _number(value: float) -> ir.Constant:
    return ir.Constant(_DOUBLE, value)


class _LookupKernel:
    """Writes the kernel of the module's loop; `text` calls the methods that fill its blocks, in their order.

    Attributes that a block sets are values of LLVM; later blocks use them. `n`, `low` and `high` are phi nodes: at the
    begin of `next_ball` they have no value yet from the blocks that return to it, which `_join_balls` adds.
    """

    def __init__(self) -> None:
        self.module = ir.Module("lookup")
        kind = ir.FunctionType(ir.VoidType(), [_INT, _INT, _POINTER, _POINTER, _POINTER])
        self.function = ir.Function(self.module, kind, "kernel")
        self.begin, self.end, arguments, results, _ = self.function.args
        names = (
            "entry",
            "next_item",
            "read_item",
            "next_ball",
            "bound_ball",
            "skip_ball",
            "bound_above",
            "refine",
            "descend",
            "store_bounds",
            "done",
        )
        self.blocks: dict[str, ir.Block] = {}
        for name in names:
            self.blocks[name] = self.function.append_basic_block(name)
        self.w = _ExpressionWriter(ir.IRBuilder(self.blocks["entry"]), self.module)
        self.b = self.w.b
        arrays = (
            "poses",
            "states",
            "pairs",
            "enough",
            "reject",
            "smallest_radius",
            "table",
            "grids",
            "values",
            "balls",
        )
        self.data: dict[str, ir.Value] = {}
        for i, name in enumerate(arrays):
            self.data[name] = self.w.at(arguments, i, _POINTER)
        self.lows = self.w.at(results, 0, _POINTER)
        self.highs = self.w.at(results, 1, _POINTER)

    def text(self) -> str:
        """Return the kernel as LLVM assembly; each method reads values that those before it have set."""
        self._next_item()
        self._read_item()
        self._next_ball()
        self._bound_ball()
        self._skip_ball()
        self._bound_above()
        self._refine()
        self._descend()
        self._join_balls()
        self._store_bounds()
        # the target is that of the machine, chosen by the compiler
        lines = []
        for line in str(self.module).splitlines():
            if not line.startswith("target "):
                lines.append(line)
        return "\n".join(lines)

    def _next_item(self) -> None:
        """Jump from the entry to the loop over items; end after the last one."""
        b = self.b
        b.branch(self.blocks["next_item"])
        b.position_at_end(self.blocks["next_item"])
        self.i = b.phi(_INT)
        self.i.add_incoming(self.begin, self.blocks["entry"])
        b.cbranch(b.icmp_signed("<", self.i, self.end), self.blocks["read_item"], self.blocks["done"])

    def _read_item(self) -> None:
        """Read the pair of shapes of an item, the pose between them, the grid, and the limits of the search."""
        b = self.b
        w = self.w
        data = self.data
        b.position_at_end(self.blocks["read_item"])
        row = w.shifted(data["table"], w.at(data["pairs"], self.i, _INT), PAIR, _INT)
        count, with_grid, with_balls, grid, self.first, self.last = w.numbers(row, PAIR, _INT)
        state = b.mul(w.at(data["states"], self.i, _INT), count)
        T_base_grid = w.shifted(data["poses"], b.add(state, with_grid), 16)
        T_base_balls = w.shifted(data["poses"], b.add(state, with_balls), 16)
        G = w.matrix(T_base_grid)
        B = w.matrix(T_base_balls)
        # T_grid_balls: rotation R, translation t
        origin_offset = w.difference(_column(B, 3), _column(G, 3))
        self.R = []
        for r in range(3):
            axis = _column(G, r)
            row_of_R = []
            for c in range(3):
                row_of_R.append(w.dot(axis, _column(B, c)))
            self.R.append(row_of_R)
        self.t = []
        for r in range(3):
            self.t.append(w.dot(_column(G, r), origin_offset))
        record = w.shifted(data["grids"], grid, GRID)
        numbers = w.numbers(record, GRID)
        self.start = numbers[:3]
        self.cell = numbers[3]
        self.cells_per_length = numbers[4]
        self.ends = numbers[5:8]
        self.strides = [b.fptosi(x, _INT) for x in numbers[8:10]]
        self.values = w.shifted(data["values"], b.fptosi(numbers[10], _INT), 1, _FLOAT)
        self.box_low = numbers[11:14]
        self.box_high = numbers[14:17]
        self.near_error, self.accurate_below, self.far_error = numbers[17:20]
        self.enough = w.at(data["enough"], self.i)
        self.reject = w.at(data["reject"], self.i)
        self.smallest_radius = w.at(data["smallest_radius"], self.i)
        # with a smallest radius, bounds are coarse anyway: a lower bound close to the upper bound is sufficient
        is_coarse = b.fcmp_ordered(">", self.smallest_radius, _number(0.0))
        self.sufficient_share = b.select(is_coarse, _number(_SUFFICIENT_SHARE), _number(1.0))
        b.branch(self.blocks["next_ball"])

    def _next_ball(self) -> None:
        """Begin the loop over balls with the bounds so far."""
        b = self.b
        read_item = self.blocks["read_item"]
        b.position_at_end(self.blocks["next_ball"])
        self.n = b.phi(_INT)
        self.low = b.phi(_DOUBLE)
        self.high = b.phi(_DOUBLE)
        self.n.add_incoming(self.first, read_item)
        self.low.add_incoming(_number(np.inf), read_item)
        self.high.add_incoming(_number(np.inf), read_item)
        # the search ends if the upper bound is below `reject`
        continues = b.and_(b.icmp_signed("<", self.n, self.last), b.fcmp_ordered(">=", self.high, self.reject))
        b.cbranch(continues, self.blocks["bound_ball"], self.blocks["store_bounds"])

    def _bound_ball(self) -> None:
        """Bound the distance of one ball from below, by the nearest node of the grid and by the grid's box."""
        b = self.b
        w = self.w
        b.position_at_end(self.blocks["bound_ball"])
        record = w.shifted(self.data["balls"], self.n, BALL)
        centre = w.numbers(record, 3)
        self.radius = w.at(record, 3)
        self.next_outside = b.fptosi(w.at(record, 4), _INT)
        self.p = []
        for r in range(3):
            turned = w.dot(self.R[r], centre)
            self.p.append(b.fadd(turned, self.t[r]))
        # in cells from the first node of the grid
        self.steps = []
        for k in range(3):
            length = b.fsub(self.p[k], self.start[k])
            self.steps.append(b.fmul(length, self.cells_per_length))
        self.stored, self.node_offset = self._stored_and_offset(self._nodes("rint"))
        zero = _number(0.0)
        beyond_box = []
        for k in range(3):
            below = b.fsub(self.box_low[k], self.p[k])
            above = b.fsub(self.p[k], self.box_high[k])
            beyond_box.append(w.most(w.most(below, above), zero))
        box_distance = w.size(beyond_box)
        self.lower = w.most(b.fsub(self.stored, self.node_offset), box_distance)
        self.next_ball = b.add(self.n, ir.Constant(_INT, 1))
        self.low_of_ball = b.fsub(self.lower, self.radius)
        limit = w.least(w.least(self.low, self.enough), b.fmul(self.high, self.sufficient_share))
        b.cbranch(b.fcmp_ordered(">=", self.low_of_ball, limit), self.blocks["skip_ball"], self.blocks["bound_above"])

    def _skip_ball(self) -> None:
        """Skip the smaller balls of a ball that is far enough away."""
        self.b.position_at_end(self.blocks["skip_ball"])
        self.low_skipped = self.w.least(self.low, self.low_of_ball)
        self.b.branch(self.blocks["next_ball"])

    def _bound_above(self) -> None:
        """Lower the upper bound; the bounds of a ball without smaller balls or with a small radius are refined."""
        b = self.b
        b.position_at_end(self.blocks["bound_above"])
        self.high_at_centre = self.w.least(self.high, self._upper(self.stored, self.node_offset))
        is_last = b.icmp_signed("==", self.next_outside, self.next_ball)
        is_smallest = b.fcmp_ordered("<=", self.radius, self.smallest_radius)
        b.cbranch(b.or_(is_last, is_smallest), self.blocks["refine"], self.blocks["descend"])

    def _refine(self) -> None:
        """Take the best bounds of the eight nodes around the centre of the ball."""
        b = self.b
        w = self.w
        b.position_at_end(self.blocks["refine"])
        corners = []
        for x, end_node in zip(self._nodes("floor"), self.ends, strict=True):
            # a cell begins at most one node before the last one
            last_start = b.fsub(end_node, _number(1.0))
            corners.append(w.least(x, last_start))
        lower = self.lower
        upper = self.high_at_centre
        for shift in product((0.0, 1.0), repeat=3):
            node = []
            for corner, cells in zip(corners, shift, strict=True):
                node.append(b.fadd(corner, _number(cells)))
            stored, offset = self._stored_and_offset(node)
            lower = w.most(lower, b.fsub(stored, offset))
            upper = w.least(upper, self._upper(stored, offset))
        self.low_refined = w.least(self.low, b.fsub(lower, self.radius))
        self.high_refined = w.least(self.high, upper)
        b.branch(self.blocks["next_ball"])

    def _descend(self) -> None:
        """Continue with the smaller balls of a ball."""
        self.b.position_at_end(self.blocks["descend"])
        self.b.branch(self.blocks["next_ball"])

    def _join_balls(self) -> None:
        """Set the next ball, and the bounds so far, after each of the three blocks that return to `next_ball`."""
        skip_ball = self.blocks["skip_ball"]
        refine = self.blocks["refine"]
        descend = self.blocks["descend"]
        self.n.add_incoming(self.next_outside, skip_ball)
        self.n.add_incoming(self.next_outside, refine)
        self.n.add_incoming(self.next_ball, descend)
        self.low.add_incoming(self.low_skipped, skip_ball)
        self.low.add_incoming(self.low_refined, refine)
        self.low.add_incoming(self.low, descend)
        self.high.add_incoming(self.high, skip_ball)
        self.high.add_incoming(self.high_refined, refine)
        self.high.add_incoming(self.high_at_centre, descend)

    def _store_bounds(self) -> None:
        """Store the bounds of an item, and continue with the next item or end."""
        b = self.b
        zero = _number(0.0)
        b.position_at_end(self.blocks["store_bounds"])
        rejected = b.fcmp_ordered("<", self.high, self.reject)
        stored_low = b.select(rejected, zero, self.w.most(self.low, zero))
        b.store(stored_low, b.gep(self.lows, [self.i], source_etype=_DOUBLE))
        b.store(self.high, b.gep(self.highs, [self.i], source_etype=_DOUBLE))
        following = b.add(self.i, ir.Constant(_INT, 1))
        self.i.add_incoming(following, self.blocks["store_bounds"])
        b.branch(self.blocks["next_item"])
        b.position_at_end(self.blocks["done"])
        b.ret_void()

    def _stored_and_offset(self, node: list[ir.Value]) -> tuple[ir.Value, ir.Value]:
        """Return (stored distance at a node, distance of the ball's centre from the node)."""
        b = self.b
        index = [b.fptosi(x, _INT) for x in node]
        row = b.add(b.mul(index[0], self.strides[0]), b.mul(index[1], self.strides[1]))
        place = b.add(row, index[2])
        stored = b.fpext(self.w.at(self.values, place, _FLOAT), _DOUBLE)
        offsets = []
        for k in range(3):
            p_node = b.fadd(self.start[k], b.fmul(node[k], self.cell))
            offsets.append(b.fsub(self.p[k], p_node))
        return stored, self.w.size(offsets)

    def _nodes(self, rounding: str) -> list[ir.Value]:
        """Return the coordinates of a node at `steps`, moved into the grid and rounded by an intrinsic of LLVM.

        "rint" gives the nearest node, "floor" the first node of the cell around the centre.
        """
        rounded = []
        for x, most in zip(self.steps, self.ends, strict=True):
            clipped = self.w.least(self.w.most(x, _number(0.0)), most)
            rounded.append(self.w.intrinsic(rounding, clipped))
        return rounded

    def _upper(self, stored: ir.Value, offset: ir.Value) -> ir.Value:
        """Return an upper bound of the distance between the surfaces.

        `stored` is the distance that the grid stores at a node, `offset` the distance of this node from the ball's
        centre.
        """
        b = self.b
        error = b.select(b.fcmp_ordered("<", stored, self.accurate_below), self.near_error, self.far_error)
        return b.fadd(b.fadd(b.fadd(stored, offset), self.radius), error)


@cache
def _kernel() -> tuple[CFuncPtr, object]:
    return compiled(_LookupKernel().text())


def look_up(
    poses: Array,
    states: np.ndarray,
    pairs: np.ndarray,
    enough: Array,
    reject: Array,
    smallest_radius: Array,
    *,
    table: np.ndarray,
    grids: Array,
    values: np.ndarray,
    balls: Array,
) -> tuple[Array, Array]:
    """Return lower and upper bounds (n,) in m of the distances of n items, each a pair of shapes in a state.

    Args:
        poses: (k, shapes, 4, 4) T_base_shape.
        states: (n,) row of `poses` of each item.
        pairs: (n,) row of `table` of each item.
        enough: (n,) in m; a larger lower bound is not required.
        reject: (n,) in m; if the upper bound is below this value, the search ends and the lower bound is 0.
        smallest_radius: (n,) in m; balls with at most this radius are not replaced by their smaller balls.
        table: (pairs, PAIR) int64.
        grids: (grids, GRID) float64.
        values: float32, the values of all grids.
        balls: (balls, BALL) float64, the balls of all shapes.
    """
    low = np.zeros(len(states))
    high = np.zeros(len(states))
    arguments = [
        np.ascontiguousarray(poses, np.float64),
        np.ascontiguousarray(states, np.int64),
        np.ascontiguousarray(pairs, np.int64),
        np.ascontiguousarray(enough, np.float64),
        np.ascontiguousarray(reject, np.float64),
        np.ascontiguousarray(smallest_radius, np.float64),
        table,
        grids,
        values,
        balls,
    ]
    inputs = _addresses(arguments)
    outputs = _addresses([low, high])
    kernel, _ = _kernel()
    kernel(0, len(states), inputs, outputs, None)
    return low, high


def _addresses(arrays: list[np.ndarray]) -> ctypes.Array[ctypes.c_void_p]:
    """Return the addresses of the memory of arrays, as the kernel takes them."""
    addresses = (ctypes.c_void_p * len(arrays))()
    for i, array in enumerate(arrays):
        addresses[i] = array.ctypes.data
    return addresses
