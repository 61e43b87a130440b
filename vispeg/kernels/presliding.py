"""Stretch of springs that yield one after the other, along a path."""

from __future__ import annotations

from vispeg.kernels.compiled import BLOCKS, NUMBER, ROWS, VECTOR, compiled, inner, to


@inner
def slipped(stretch, most):
    """Return the stretch of an element that slips at the stretch `most`."""
    return most if stretch > most else -most if stretch < -most else stretch


@compiled(to(BLOCKS), ROWS, ROWS, ROWS, VECTOR, to(ROWS))
def pulled(anchors, q, stiffness, level, yields, out):
    """Write the torque (n, nj) N m of elements at `q` (n, nj) rad, and move the anchors of those that slip.

    The `anchors` (n, nj, k) rad are where the elements have no torque. Element i slips at the torque `level *
    yields[i]`, and all together have the `stiffness`, both (n, nj).

    Raises:
        ValueError: the arrays differ in shape.
    """
    n, nj, count = anchors.shape
    for shape in (q.shape, stiffness.shape, level.shape, out.shape):
        if shape != (n, nj):
            raise ValueError("the joints' values differ in shape")
    if len(yields) != count:
        raise ValueError("each element needs its yield")
    for r in range(n):
        for j in range(nj):
            reach, total = level[r, j] / stiffness[r, j], 0.0
            for i in range(count):
                stretch = slipped(q[r, j] - anchors[r, j, i], reach * yields[i])
                anchors[r, j, i] = q[r, j] - stretch
                total += stretch
            out[r, j] = -stiffness[r, j] * total / count


@compiled(VECTOR, NUMBER, VECTOR, to(VECTOR))
def stretched(path, reach, yields, out):
    """Write the mean stretch (n,) of elements along a path (n,) that begins with all of them slack.

    Element i slips when it is stretched by `reach * yields[i]`, and then drags its anchor along. Lengths are in the
    path's unit.
    """
    out[:] = 0.0
    for share in yields:
        most, anchor = reach * share, path[0]  # stretch at which the element slips, place where it is slack
        for k in range(len(path)):
            stretch = slipped(path[k] - anchor, most)
            anchor = path[k] - stretch
            out[k] += stretch
    out /= len(yields)
