"""The plant: a tool with a round peg on an impedance-controlled flange, over a fixture with a hole. NumPy, many rows.

Law of a contact: Hunt and Crossley 1975, `f = k d (1 + chi d')`, never pulling. Friction of each patch: a tangential
spring that slips at the cone, `|f_t| <= mu f_n`, so that what sticks stays. A fixture that gives way is a mass on
springs, a peg that does so in the fingers a massless spring with a dashpot; it slips there by Coulomb's law.

Flange: Khatib's law with the nominal inertia at the hole, so free motion is `a = kp e - kd v`; semi-implicit Euler.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from contact_arm import apparent, cross_matrix, joints, rotation_vector, turn
from contact_geometry import GROUP, SHARE, Shape, contacts, gap

STEEL, GRAVITY = 7850.0, np.array([0.0, 0.0, -9.81])
MOUTH = np.array([0.6, 0.0, 0.05])  # m, base frame
DOWN = np.diag([-1.0, 1.0, -1.0])  # the flange looks down, its y along the base's, as at HOME
TIP, CENTRE = 0.185, 0.145  # m under the flange: the peg's end, its middle
PEG, LENGTH = 0.008, 0.08  # m: radius, length
FINE, COARSE = 2.5e-4, 1e-3  # s
RATE = 500.0  # Hz
KP = np.array([300.0] * 3 + [1000.0] * 3)  # 1/s^2; on a softer wrist the strokes would not slide
KD = 2 * np.sqrt(KP)
HOLD = 120.0  # N: the grip's friction along the peg
LAG = 0.004  # s, least: dashpot over spring of a peg that gives way in the fingers
FIXTURE = np.array([0.6] * 3 + [1.5e-3] * 2)  # kg, kg m^2: what moves where the fixture gives way
SLACK = 500.0  # N s/m: what brakes a loose peg
CREEP = 2000.0  # N s/m: force over what the grip holds per speed at which a peg slips in it
# kg that contacts feel on planes and across the peg, and of a fixture that gives way: makes the damping's step implicit
FELT, FELT_GIVING = np.array([3.0, 0.3]), np.array([0.6, 0.2])
ACROSS = (GROUP != 0).astype(int)
STIFF, DAMP = 1e6, 148.0  # N/m, s/m: the nominal contact; damping for a restitution of 0.135 at 50 mm/s


@dataclass(frozen=True)
class Truth:
    """What one plant is, SI; the defaults are nominal. Axes as the effects of the same names have them."""

    friction: float = 0.3
    stick: float = 1.0  # static over sliding friction
    stiffness: float = STIFF
    damping: float = DAMP
    offset: tuple = (0.0, 0.0, 0.0)  # of the hole, base axes
    tilt: tuple = (0.0, 0.0)  # roll, pitch of the fixture
    width: float = 0.0  # added to the hole's diameter
    fixture: tuple = (0.0,) * 5  # m/N x y z, rad/(N m) roll pitch
    grasp: tuple = (0.0,) * 5  # the same of the peg in the fingers, flange axes
    grip: tuple = (0.0,) * 5  # x y z, roll pitch of the peg in the fingers
    hold: float = HOLD
    play: float = 0.0  # m: a loose gripper's, sideways
    tool: float = 0.0  # kg added to the gripper
    com: tuple = (0.0, 0.0, 0.0)  # m, of the gripper
    object: float = 1.0  # scale of the peg's mass
    bias: tuple = (0.0,) * 6
    gain: float = 1.0
    delay: float = 0.0
    pad: float = 0.0  # m: a soft gasket on top
    bump: float = 0.0  # m: a chip on the wall
    clearance: float = 3e-3  # m, nominal, diametral


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return `a x b` along the last axis; NumPy's own takes ten times as long on small arrays."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def column(truths: list[Truth], name: str) -> np.ndarray:
    """Return a field of all rows, (n,) or (n, k)."""
    return np.array([getattr(t, name) for t in truths], float)


def nominal_tool() -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre (3,) and inertia (3, 3) about the flange of the gripper: a housing and two fingers, boxes."""
    boxes = [(0.62, (0.08, 0.05, 0.10), (0, 0, 0.05))]
    boxes += [(0.04, (0.012, 0.02, 0.045), (sign * (PEG + 0.006), 0, 0.1225)) for sign in (1, -1)]
    total, first, second = 0.0, np.zeros(3), np.zeros((3, 3))
    for m, size, at in boxes:
        at, (x, y, z) = np.array(at, float), np.square(size)
        second += m / 12 * np.diag([y + z, x + z, x + y]) + m * (at @ at * np.eye(3) - np.outer(at, at))
        total, first = total + m, first + m * at
    return total, first / total, second


def held(truth: Truth) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre (3,) and inertia (3, 3) about the flange of gripper and peg together, flange axes."""
    m, com, inertia = nominal_tool()
    new = m + truth.tool
    inertia = inertia * new / m
    shift = np.array(truth.com)
    inertia += new * ((com + shift) @ (com + shift) - com @ com) * np.eye(3)
    inertia -= new * (np.outer(com + shift, com + shift) - np.outer(com, com))
    peg = STEEL * np.pi * PEG**2 * LENGTH * truth.object
    at = np.array([0, 0, CENTRE]) + np.array(truth.grip[:3])
    own = peg / 12 * np.diag([3 * PEG**2 + LENGTH**2] * 2 + [6 * PEG**2])
    inertia += own + peg * (at @ at * np.eye(3) - np.outer(at, at))
    total = new + peg
    return total, (new * (com + shift) + peg * at) / total, inertia


def spatial(m: np.ndarray, com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Return the inertia (n, 6, 6) at the flange: force and torque over linear and angular acceleration there."""
    out = np.zeros((len(m), 6, 6))
    k = cross_matrix(com) * m[:, None, None]
    out[:, :3, :3] = m[:, None, None] * np.eye(3)
    out[:, :3, 3:], out[:, 3:, :3], out[:, 3:, 3:] = -k, k, inertia
    return out


@dataclass
class Log:
    """What happened, one row a sample: flange (n, t, 3), (n, t, 3, 3), wrench on the tool (n, t, 6) in flange axes,
    contact force on the peg (n, t, 3), tip in the hole's nominal frame (n, t, 3), energy (n, t) J.
    """

    pos: np.ndarray
    rot: np.ndarray
    wrench: np.ndarray
    force: np.ndarray
    tip: np.ndarray
    energy: np.ndarray


class Plant:
    """Rows of plants that start at rest in free air.

    Args:
        truths: what each is.
        pos, rot: (n, 3), (n, 3, 3) of the flange.
        limit: (n,) N, of the commanded force.
        arm: (6, 6) apparent inertia of the bare arm; of the nominal arm over the hole if not given.
    """

    def __init__(
        self, truths: list[Truth], pos: np.ndarray, rot: np.ndarray, limit: np.ndarray, arm: np.ndarray | None = None
    ):
        n = len(truths)
        self.n, self.truths, self.limit = n, truths, np.asarray(limit, float)
        self.pos, self.rot = pos.copy(), rot.copy()
        self.vel, self.spin = np.zeros((n, 3)), np.zeros((n, 3))
        self.acc, self.turning = np.zeros((n, 3)), np.zeros((n, 3))
        over = MOUTH + np.array([0, 0, TIP])
        self.arm = apparent(joints(over[None], DOWN[None])[0]) if arm is None else arm
        m, com, inertia = (np.array(x) for x in zip(*map(held, truths), strict=True))
        m0, com0, inertia0 = (np.array(x)[None] for x in held(Truth()))
        self.m, self.com, self.inertia, self.m0, self.com0 = m, com, inertia, m0, com0
        self.law = self.arm + _turned(spatial(m0, com0, inertia0), DOWN[None])[0]  # what the controller believes
        self.inverse = np.linalg.inv(self.arm + _turned(spatial(m, com, inertia), np.tile(DOWN, (n, 1, 1))))

        def get(name):
            return column(truths, name)

        one = np.ones(n)
        self.shape = Shape(PEG * one, PEG + 0.5 * (get("clearance") + get("width")), 1e-3 * one, 0.025 * one,
                           0.05 * one, -0.05 * one, get("pad"), get("bump"))  # fmt: skip
        self.mu, self.stick = get("friction"), get("stick")
        self.k, self.chi = get("stiffness"), get("damping")
        self.origin = MOUTH + get("offset")
        self.upright = _rpy(get("tilt"))
        self.grip, self.askew = get("grip"), _rpy(get("grip")[:, 3:])
        self.give, self.grasp, self.hold, self.play = get("fixture"), get("grasp"), get("hold"), get("play")
        self.yielded, self.yielding = np.zeros((n, 5)), np.zeros((n, 5))  # of the fixture
        self.peg = np.zeros((n, 5))  # in the fingers
        felt = self.k[:, None] * np.array([1.0] * 3 + [1.6e-3] * 2)  # a contact's stiffness there, levers of 40 mm
        self.lag = np.maximum(LAG, 3.0 * FINE * self.grasp * felt)  # two contacts at once bear on it
        self.felt = np.where(self.give.any(axis=1)[:, None], FELT_GIVING, FELT)
        self.borne = np.zeros((n, 2))  # N, what the contacts on planes and across the peg carried lately
        self.bristle = np.zeros((n, 3, 3))  # row, group, hole axes
        self.load, self.force, self.tip = np.zeros((n, 6)), np.zeros((n, 3)), np.zeros((n, 3))
        self.command = np.zeros((n, 6))
        self.stored = np.zeros(n)

    def control(self, pos: np.ndarray, rot: np.ndarray) -> None:
        """Apply Khatib's law towards flange poses (n, 3), (n, 3, 3); its force is cut at the limit."""
        error = np.concatenate([pos - self.pos, rotation_vector(rot @ np.swapaxes(self.rot, 1, 2))], axis=1)
        ask = (KP * error - KD * np.concatenate([self.vel, self.spin], axis=1)) @ self.law.T
        size = np.linalg.norm(ask[:, :3], axis=1)
        ask[:, :3] *= np.minimum(1.0, self.limit / np.maximum(size, 1e-12))[:, None]
        self.command = ask

    def near(self) -> bool:
        """Test whether any row may touch something within a coarse step."""
        self._place()
        return bool((gap(self.tip, self.shape) < 2e-3).any())

    def _place(self) -> tuple[np.ndarray, ...]:
        """Return tip and axis in the hole's frame, the hole's rotation, the tip and the frame's origin in the base."""
        n = self.n
        turned = self.rot @ _small(self.askew, self.peg[:, 3:])
        middle = np.column_stack([self.grip[:, :2] + self.peg[:, :2], CENTRE + self.grip[:, 2] + self.peg[:, 2]])
        tip = self.pos + (self.rot @ middle[:, :, None])[:, :, 0] + turned[:, :, 2] * (TIP - CENTRE)
        rocked = np.concatenate([self.yielded[:, 3:], np.zeros((n, 1))], axis=1)
        frame = _approx(rocked) @ self.upright
        origin = self.origin + self.yielded[:, :3]
        back = np.swapaxes(frame, 1, 2)
        self.tip = (back @ (tip - origin)[:, :, None])[:, :, 0]
        axis = -(back @ turned[:, :, 2:])[:, :, 0]
        return self.tip, axis, frame, tip, origin

    def step(self, h: float) -> None:
        """Advance by h seconds under the held command."""
        local, axis, frame, tip, origin = self._place()
        push, torque_fixture, contact = np.zeros((self.n, 3)), np.zeros((self.n, 3)), np.zeros((self.n, 6))
        self.stored = np.zeros(self.n)
        if (gap(local, self.shape) < 0).any():
            push, torque_fixture, contact = self._touch(local, axis, frame, tip, origin, h)
        else:
            self.bristle[:], self.borne[:] = 0.0, 0.0
        self.force = push
        self._yield(push, torque_fixture, contact, h)
        lever = (self.rot @ self.com[:, :, None])[:, :, 0]
        lever0 = (self.rot @ self.com0[:, :, None])[:, :, 0]
        weight, weight0 = self.m[:, None] * GRAVITY, np.tile(self.m0 * GRAVITY, (self.n, 1))
        gravity = np.concatenate([weight, cross(lever, weight)], axis=1)
        believed = np.concatenate([weight0, cross(lever0, weight0)], axis=1)
        total = self.command + contact + gravity - believed
        acc = (self.inverse @ total[:, :, None])[:, :, 0]
        self.acc, self.turning = acc[:, :3], acc[:, 3:]
        self.load = self._wrench(lever, gravity, contact)
        self.vel += h * self.acc
        self.spin += h * self.turning
        self.pos += h * self.vel
        self.rot = turn(h * self.spin) @ self.rot

    def _wrench(self, lever: np.ndarray, gravity: np.ndarray, contact: np.ndarray) -> np.ndarray:
        """Return what the flange exerts on the tool (n, 6), flange axes: inertia less weight less contact."""
        w = self.spin
        inertia = self.rot @ self.inertia @ np.swapaxes(self.rot, 1, 2)
        force = self.m[:, None] * (self.acc + cross(self.turning, lever) + cross(w, cross(w, lever)))
        moment = (inertia @ self.turning[:, :, None])[:, :, 0] + self.m[:, None] * cross(lever, self.acc)
        moment += cross(w, (inertia @ w[:, :, None])[:, :, 0])
        needed = np.concatenate([force, moment], axis=1) - gravity - contact
        back = np.swapaxes(self.rot, 1, 2)
        return np.concatenate([(back @ needed[:, :3, None])[:, :, 0], (back @ needed[:, 3:, None])[:, :, 0]], axis=1)

    def _touch(self, local, axis, frame, tip, origin, h):
        """Return the contact force on the peg, its torque about the fixture's origin, its wrench at the flange."""
        back = np.swapaxes(frame, 1, 2)
        points, normals, depth = contacts(local, axis, self.shape)
        world = origin[:, None] + points @ back
        moving = self.vel[:, None] + cross(self.spin[:, None], world - self.pos[:, None])
        if self.give.any():
            turning = np.concatenate([self.yielding[:, 3:], np.zeros((self.n, 1))], axis=1)
            moving = moving - self.yielding[:, None, :3] - cross(turning[:, None], world - origin[:, None])
        moving = moving @ frame  # hole's axes
        rate = -np.sum(moving * normals, axis=2)
        soft = np.where(self.shape.pad > 0, 0.02, 1.0)[:, None] * np.where(GROUP == 0, 1.0, 0.0) + (GROUP != 0)
        k = self.k[:, None] * SHARE * soft
        pressed = k * np.maximum(depth, 0.0)
        ahead = h * self.chi[:, None] / self.felt  # damping by the speed that the step ends with
        damped = np.maximum(1 + self.chi[:, None] * rate + (ahead * self.borne)[:, ACROSS], 0.0)
        size = pressed * damped / (1 + ahead * _by_way(pressed))[:, ACROSS]
        self.borne += 0.3 * (_by_way(size) - self.borne)
        self.stored = 0.5 * np.sum(np.where(depth > 0, k * depth**2, 0.0), axis=1)
        normal = size[..., None] * normals
        total = normal.sum(axis=1)
        about = cross(points, normal).sum(axis=1)
        for g in range(3):
            pick = GROUP == g
            f = size[:, pick]
            load = f.sum(axis=1)
            weight = f / np.maximum(load, 1e-12)[:, None]
            centre = np.einsum("nk,nkc->nc", weight, points[:, pick])
            face = np.einsum("nk,nkc->nc", weight, normals[:, pick])
            face /= np.maximum(np.linalg.norm(face, axis=1), 1e-12)[:, None]
            slide = np.einsum("nk,nkc->nc", weight, moving[:, pick])
            slide -= np.sum(slide * face, axis=1)[:, None] * face
            drag = self._friction(g, load, face, slide, h)
            total = total + drag
            about = about + cross(centre, drag)
        push = (frame @ total[:, :, None])[:, :, 0]
        at_origin = (frame @ about[:, :, None])[:, :, 0]
        at_flange = at_origin + cross(origin - self.pos, push)
        return push, at_origin, np.concatenate([push, at_flange], axis=1)

    def _friction(self, g: int, load: np.ndarray, face: np.ndarray, slide: np.ndarray, h: float) -> np.ndarray:
        """Return a patch's force (n, 3) N: a spring of half the contact's stiffness with a dashpot, cut at the cone."""
        z = self.bristle[:, g] + h * slide
        z = z - np.sum(z * face, axis=1)[:, None] * face
        z[load <= 0] = 0.0
        stiff = 0.5 * self.k
        damp = 2 * 0.7 * np.sqrt(stiff * 0.8)  # of a tool of 0.8 kg
        force = -stiff[:, None] * z - damp[:, None] * slide
        pull = np.linalg.norm(force, axis=1)
        speed = np.linalg.norm(slide, axis=1)
        most = self.mu * load * (1 + (self.stick - 1) * np.exp(-((speed / 0.004) ** 2)))
        over = pull > most
        share = np.where(over, most / np.maximum(pull, 1e-12), 1.0)
        force = force * share[:, None]
        slipped = -(force + damp[:, None] * slide) / stiff[:, None]
        longest = (most / stiff)[:, None]
        length = np.linalg.norm(slipped, axis=1, keepdims=True)
        slipped *= np.minimum(1.0, longest / np.maximum(length, 1e-12))
        self.bristle[:, g] = np.where(over[:, None], slipped, z)
        self.stored = self.stored + 0.5 * stiff * np.sum(self.bristle[:, g] ** 2, axis=1)
        return force

    def _yield(self, push: np.ndarray, torque: np.ndarray, contact: np.ndarray, h: float) -> None:
        """Let what gives way move towards its springs' rest under the load, with a lag; the peg slips and rattles."""
        if self.give.any():
            load = np.concatenate([-push, -torque[:, :2]], axis=1)
            gives, spring = self.give > 0, 1 / np.maximum(self.give, 1e-12)
            drag = 2 * 0.5 * np.sqrt(spring * FIXTURE)
            speed = self.yielding + h * (load - spring * self.yielded) / FIXTURE
            self.yielding = np.where(gives, speed / (1 + h * drag / FIXTURE), 0.0)
            self.yielded = self.yielded + h * self.yielding
            self.stored = self.stored + 0.5 * np.sum(
                np.where(gives, spring * self.yielded**2 + FIXTURE * self.yielding**2, 0.0), axis=1
            )
        back = np.swapaxes(self.rot, 1, 2)
        force = (back @ push[:, :, None])[:, :, 0]  # on the peg, flange axes
        centre = self.pos + self.rot[:, :, 2] * CENTRE
        moment = contact[:, 3:] - cross(centre - self.pos, push)
        moment = (back @ moment[:, :, None])[:, :, 0]
        if self.grasp.any():
            springy = self.grasp * np.concatenate([force, moment[:, :2]], axis=1)
            pace = -np.expm1(-h / self.lag)
            self.peg = np.where(self.grasp > 0, self.peg + pace * (springy - self.peg), self.peg)
        if self.play.any():
            loose = np.clip(self.peg[:, :2] + h * force[:, :2] / SLACK, -self.play[:, None], self.play[:, None])
            self.peg[:, :2] = np.where(self.play[:, None] > 0, loose, self.peg[:, :2])
        over = np.maximum(np.abs(force[:, 2]) - self.hold, 0.0)
        self.peg[:, 2] += np.where(over > 0, h * np.sign(force[:, 2]) * over / CREEP, 0.0)

    @property
    def energy(self) -> np.ndarray:
        """Energy (n,) J of motion, of the contacts' springs and of the tool's weight that nothing compensates."""
        motion = np.concatenate([self.vel, self.spin], axis=1)
        lever = (self.rot @ self.com[:, :, None])[:, :, 0]
        lever0 = (self.rot @ self.com0[:, :, None])[:, :, 0]
        height = self.m * (self.pos + lever)[:, 2] - self.m0 * (self.pos + lever0)[:, 2]
        moving = 0.5 * np.einsum("ni,nij,nj->n", motion, np.linalg.inv(self.inverse), motion)
        return moving + self.stored + 9.81 * height


def _by_way(size: np.ndarray) -> np.ndarray:
    """Sum contacts (n, k) to (n, 2): on planes, across the peg."""
    return np.stack([size[:, ACROSS == 0].sum(axis=1), size[:, ACROSS == 1].sum(axis=1)], axis=1)


def _rpy(angles: np.ndarray) -> np.ndarray:
    """Return Ry(pitch) Rx(roll), (n, 3, 3), of roll and pitch (n, 2) rad."""
    zero = np.zeros(len(angles))
    return turn(np.stack([zero, angles[:, 1], zero], axis=1)) @ turn(np.stack([angles[:, 0], zero, zero], axis=1))


def _approx(v: np.ndarray) -> np.ndarray:
    """Return `turn(v)`, faster where all are 0."""
    return turn(v) if v.any() else np.tile(np.eye(3), (len(v), 1, 1))


def _small(base: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return a rotation (n, 3, 3) followed, in the same axes, by small angles (n, 2) about x and y."""
    return _approx(np.concatenate([angles, np.zeros((len(angles), 1))], axis=1)) @ base


def _turned(inertia: np.ndarray, rot: np.ndarray) -> np.ndarray:
    """Return a spatial inertia (n, 6, 6) in the axes that `rot` (n, 3, 3) turns the old ones into."""
    both = np.zeros((len(rot), 6, 6))
    both[:, :3, :3] = both[:, 3:, 3:] = rot
    return both @ inertia @ np.swapaxes(both, 1, 2)


def run(truths: list[Truth], pos: np.ndarray, rot: np.ndarray, limit: np.ndarray) -> Log:
    """Drive plants along flange poses pos (n, t, 3) m, rot (n, t, 3, 3), one per control tick of 1 / RATE s."""
    n, ticks = pos.shape[:2]
    plant = Plant(truths, pos[:, 0], rot[:, 0], limit)
    log = Log(*(np.zeros((n, ticks, *s)) for s in ((3,), (3, 3), (6,), (3,), (3,), ())))
    wrench = plant._wrench(*_still(plant))
    for t in range(ticks):
        log.pos[:, t], log.rot[:, t], log.wrench[:, t] = plant.pos, plant.rot, wrench
        log.force[:, t], log.energy[:, t] = plant.force, plant.energy
        plant.control(pos[:, t], rot[:, t])
        near = plant.near()
        log.tip[:, t] = plant.tip
        h = FINE if near else COARSE
        count = round(1 / RATE / h)
        wrench = np.zeros((n, 6))
        for _ in range(count):
            plant.step(h)
            wrench += plant.load / count
    return log


def _still(plant: Plant) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lever = (plant.rot @ plant.com[:, :, None])[:, :, 0]
    weight = plant.m[:, None] * GRAVITY
    return lever, np.concatenate([weight, cross(lever, weight)], axis=1), np.zeros((plant.n, 6))
