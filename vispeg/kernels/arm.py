"""Kinematics, inertia and operational space control of arms. Each row is one arm, computed independently of others.

Arrays and units are those of `vispeg.control.laws` and `vispeg.sim.nominal`, which call these functions.
"""

from __future__ import annotations

import math

import numpy as np

from vispeg.kernels.compiled import BLOCKS, FLAGS, NUMBER, PLACES, ROWS, VECTOR, WHOLE, WHOLES, compiled, inner, to

SMALL = 1e-12  # guards divisions by the sine of half an angle, and by a force in N


@inner
def turn(a, b, out):
    """Write the rotation vector (3,) rad from orientation `a` to `b`, (4,) wxyz each, with an angle of at most pi."""
    w = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    x = a[0] * b[1] - a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    y = a[0] * b[2] - a[2] * b[0] + a[3] * b[1] - a[1] * b[3]
    z = a[0] * b[3] - a[3] * b[0] + a[1] * b[2] - a[2] * b[1]
    if w < 0:
        x, y, z = -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, abs(w)) / sine if sine > SMALL else 2.0
    out[0], out[1], out[2] = x * factor, y * factor, z * factor


@inner
def cholesky(matrix, out):
    """Write the lower Cholesky factor of a matrix, with inverted diagonal; return whether it is positive definite."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            rest = matrix[i, j]
            for k in range(j):
                rest -= out[i, k] * out[j, k]
            if j < i:
                out[i, j] = rest * out[j, j]
            elif rest > 0:
                out[i, i] = 1.0 / math.sqrt(rest)
            else:
                return False
    return True


@inner
def forward(lower, x):
    """Solve `L y = x` in place, for a factor of `cholesky`."""
    for i in range(len(x)):
        value = x[i]
        for k in range(i):
            value -= lower[i, k] * x[k]
        x[i] = value * lower[i, i]


@inner
def backward(lower, x):
    """Solve `L' y = x` in place, for a factor of `cholesky`."""
    for i in range(len(x) - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, len(x)):
            value -= lower[k, i] * x[k]
        x[i] = value * lower[i, i]


@inner
def copy_row(mass, jac, row, inertia, j6):
    """Copy inertia and Jacobian of one row, so that other functions need compiling only for contiguous matrices."""
    for i in range(len(inertia)):
        for k in range(len(inertia)):
            inertia[i, k] = mass[row, i, k]
    for i in range(len(j6)):
        for k in range(len(inertia)):
            j6[i, k] = jac[row, i, k]


@inner
def mobility(mass, jac, lower, half, out):
    """Write the inverse of the operational inertia, `J M^-1 J'` (m, m); return whether `mass` is positive definite.

    `lower` (nv, nv) becomes the factor L of `mass` (see `cholesky`), and `half` (m, nv) the transpose of `L^-1 J'`.
    """
    if not cholesky(mass, lower):
        return False
    for i in range(len(jac)):
        for k in range(len(mass)):
            half[i, k] = jac[i, k]
        forward(lower, half[i])
        for j in range(i + 1):
            total = 0.0
            for k in range(len(mass)):
                total += half[i, k] * half[j, k]
            out[i, j] = out[j, i] = total
    return True


@inner
def condition(matrix, lower, column):
    """Return an upper bound of a matrix's condition number: its trace times that of its inverse.

    `lower` is its factor (see `cholesky`), `column` (m,) working memory.
    """
    trace, inverse_trace = 0.0, 0.0
    for i in range(len(matrix)):
        trace += matrix[i, i]
        for j in range(i, len(matrix)):  # column i of L^-1
            value = 1.0 if j == i else 0.0
            for k in range(i, j):
                value -= lower[j, k] * column[k]
            column[j] = value * lower[j, j]
            inverse_trace += column[j] * column[j]
    return trace * inverse_trace


@compiled(ROWS, ROWS, to(ROWS))
def turns(measured, commanded, out):
    """Write the rotation vectors (n, 3) rad from measured to commanded orientations, (n, 4) wxyz each; see `turn`."""
    for r in range(len(out)):
        turn(measured[r], commanded[r], out[r])


@compiled(
    *(BLOCKS, BLOCKS, ROWS, ROWS, ROWS, ROWS, ROWS, ROWS, ROWS, ROWS, VECTOR, NUMBER),
    *(to(ROWS), to(FLAGS)),
)
def hold(mass, jac, now, turned, dq, pos, rot, kp, kd, pull, limit, worst, out, done):
    """Write the torque (n, nv) N m of `laws.osc` towards a pose, and the rows `done` (n,) for which it is valid.

    Rows near a singularity (condition number above `worst`) or with values that are not finite are not done; the caller
    computes them by `laws.osc`. The flange is at position `now` (n, 3) and orientation `turned` (n, 4). The other
    arguments are those of `laws.hold_pose`, but `pull` may have no rows, and `limit` (N) has length n or 1 and may be
    infinite.

    Raises:
        ValueError: an array with another number of rows, which would be read beyond its end.
    """
    n, nv = dq.shape
    for rows in (len(mass), len(jac), len(now), len(turned), len(pos), len(rot), len(kp), len(kd), len(out), len(done)):
        if rows != n:
            raise ValueError("the signals differ in their number of rows")
    if len(pull) not in (0, n) or len(limit) not in (1, n):
        raise ValueError("the signals differ in their number of rows")
    inertia, lower, j6, half = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((6, nv)), np.empty((6, nv))
    core, factor, column = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    error, force, null = np.empty(6), np.empty(6), np.empty(6)
    for r in range(len(out)):
        done[r] = False
        copy_row(mass, jac, r, inertia, j6)
        if not mobility(inertia, j6, lower, half, core) or not cholesky(core, factor):
            continue
        if not condition(core, factor, column) < worst:
            continue
        for i in range(3):
            error[i] = pos[r, i] - now[r, i]
        turn(turned[r], rot[r], error[3:])
        for i in range(6):
            twist = 0.0
            for k in range(nv):
                twist += j6[i, k] * dq[r, k]
            force[i] = kp[r, i] * error[i] - kd[r, i] * twist
        forward(factor, force)
        backward(factor, force)
        norm = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
        most = limit[r if len(limit) > 1 else 0]
        if norm > most:
            for i in range(3):
                force[i] *= most / max(norm, SMALL)
        if len(pull):  # Jbar' tau_0 = Lambda J M^-1 tau_0, with tau_0 = M pull
            for i in range(6):
                null[i] = 0.0
                for k in range(nv):
                    null[i] += j6[i, k] * pull[r, k]
            forward(factor, null)
            backward(factor, null)
            for i in range(6):
                force[i] -= null[i]
        finite = True
        for k in range(nv):
            torque = 0.0
            for i in range(6):
                torque += j6[i, k] * force[i]
            if len(pull):
                for i in range(nv):
                    torque += inertia[k, i] * pull[r, i]
            out[r, k] = torque
            finite = finite and math.isfinite(torque)
        done[r] = finite


@compiled(BLOCKS, BLOCKS, ROWS, ROWS, ROWS, ROWS, ROWS, NUMBER, to(ROWS))
def towards(mass, jac, now, turned, pos, rot, pull, soft, out):
    """Write the displacement of the joints (n, nv) rad that moves the flange to a pose, to first order.

    The flange is at position `now` (n, 3) and orientation `turned` (n, 4); the pose is `pos` and `rot`. The Jacobian's
    inverse is weighted by inertia. `soft` is added to the diagonal of the inverse operational inertia. The part of
    `pull` (n, nv) rad in the null space is added to the displacement. The result is NaN if a matrix is not positive
    definite.
    """
    nv = out.shape[1]
    inertia, lower, j6, half = np.empty((nv, nv)), np.empty((nv, nv)), np.empty((6, nv)), np.empty((6, nv))
    core, factor, error, way = np.empty((6, 6)), np.empty((6, 6)), np.empty(6), np.empty(nv)
    for r in range(len(out)):
        copy_row(mass, jac, r, inertia, j6)
        definite = mobility(inertia, j6, lower, half, core)
        for i in range(6):
            core[i, i] += soft
        if not definite or not cholesky(core, factor):
            for k in range(nv):
                out[r, k] = np.nan
            continue
        for i in range(3):
            error[i] = pos[r, i] - now[r, i]
        turn(turned[r], rot[r], error[3:])
        for i in range(6):
            for k in range(nv):
                error[i] -= j6[i, k] * pull[r, k]
        forward(factor, error)
        backward(factor, error)
        for k in range(nv):
            way[k] = 0.0
            for i in range(6):
                way[k] += half[i, k] * error[i]
        backward(lower, way)  # M^-1 J' error
        for k in range(nv):
            out[r, k] = pull[r, k] + way[k]


@compiled(
    *(ROWS, BLOCKS, BLOCKS, BLOCKS, BLOCKS, ROWS, PLACES, WHOLES, FLAGS, VECTOR, WHOLE, WHOLE, WHOLE),
    *(to(BLOCKS), to(BLOCKS), *(to(ROWS),) * 3),
)
def operational(
    sparse, cdof, points, com, frames, bias, place, dofs, moves, fixed, site, root, body, mass, jac, pos, quat, gravity
):
    """Write inertia (n, nj, nj), Jacobian (n, 6, nj), flange position (n, 3), orientation (n, 4) and gravity (n, nj).

    Args:
        sparse, cdof, points, com, frames, bias: MuJoCo's `M`, `cdof`, `site_xpos`, `subtree_com`, `xquat` and
            `qfrc_bias` of each row.
        place: (nj, nj) index in `sparse` of each element of the inertia; -1 for an element that is 0.
        dofs: (nj,) indices of the joints' degrees of freedom.
        moves: (nj,) whether each joint moves the flange.
        fixed: (4,) wxyz, the flange's orientation in its body.
        site, root, body: indices of the flange's site, of the root body of its tree, and of its body.
        mass, jac, pos, quat, gravity: outputs.
    """
    nj = len(dofs)
    turned = np.empty(4)
    for r in range(len(mass)):
        for i in range(nj):
            for j in range(nj):
                mass[r, i, j] = sparse[r, place[i, j]] if place[i, j] >= 0 else 0.0
            gravity[r, i] = bias[r, dofs[i]]
        for i in range(3):
            pos[r, i] = points[r, site, i]
        x, y, z = (pos[r, 0] - com[r, root, 0], pos[r, 1] - com[r, root, 1], pos[r, 2] - com[r, root, 2])
        for k in range(nj):  # screws: rotation, then translation at the tree's centre of mass, as in `mj_jac`
            d, moved = dofs[k], 1.0 if moves[k] else 0.0
            a, b, c = moved * cdof[r, d, 0], moved * cdof[r, d, 1], moved * cdof[r, d, 2]
            jac[r, 0, k] = moved * cdof[r, d, 3] + (b * z - c * y)
            jac[r, 1, k] = moved * cdof[r, d, 4] + (c * x - a * z)
            jac[r, 2, k] = moved * cdof[r, d, 5] + (a * y - b * x)
            jac[r, 3, k], jac[r, 4, k], jac[r, 5, k] = a, b, c
        w0, x0, y0, z0 = frames[r, body, 0], frames[r, body, 1], frames[r, body, 2], frames[r, body, 3]
        w, x, y, z = fixed
        turned[0] = w * w0 - x * x0 - y * y0 - z * z0
        turned[1] = x * w0 + w * x0 + z * y0 - y * z0
        turned[2] = y * w0 - z * x0 + w * y0 + x * z0
        turned[3] = z * w0 + y * x0 - x * y0 + w * z0
        lead = 0
        if not abs(turned[0]) > 0.5:  # sign as in `mju_mat2Quat`: w is positive if above 1/2, else the largest of x y z
            lead = 1
            for i in range(2, 4):
                if abs(turned[i]) > abs(turned[lead]):
                    lead = i
        sign = math.copysign(1.0, turned[lead])
        for i in range(4):
            quat[r, i] = sign * turned[i]
