"""Stretch of springs that yield one after the other, along a path."""

from __future__ import annotations

from vispeg.kernels.compiled import NUMBER, VECTOR, compiled, to


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
            stretch = path[k] - anchor
            if stretch > most:
                stretch, anchor = most, path[k] - most
            elif stretch < -most:
                stretch, anchor = -most, path[k] + most
            out[k] += stretch
    out /= len(yields)
