"""SO(3): hat, vee, exp, log and their left Jacobians, one text for CasADi and NumPy.

A rotation vector w is the angle |w| about the axis w/|w|. Left Jacobian: exp(w + δ) = exp(J_l(w) δ) exp(w) to first
order in δ. [Barfoot, State Estimation for Robotics, ch. 7]; [Paper] under eq. (8) for the logarithm.

Every quotient that is 0/0 at w = 0 goes over to its Taylor series there. CasADi's ``if_else`` differentiates both
branches, so the dead branch is fed 1 instead of the small number and stays finite with finite derivatives.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import factorial, pi
from typing import Any

from nhpocp.arrays import Array, cross, dot, namespace, norm
from nhpocp.declared import degrees_hint
from nhpocp.errors import InvalidProblemError, OrientationAtPiError, describe
from nhpocp.singular_values import svd
from nhpocp.written_numbers import numbers_in

# arcsin(s)/s in powers of s²
ARCSINE = [1.0, 1 / 6, 3 / 40, 15 / 336, 105 / 3456, 945 / 42240, 10395 / 599040]
GROUP_TOLERANCE = 1e-6  # how far a matrix or quaternion may be from SO(3)
ROUNDED = 1e-14  # how far RᵀR is from the unit matrix by rounding alone
WRITINGS = {
    "rpy": "[roll, pitch, yaw]",
    "quaternion": "[w, x, y, z]",
    "rotvec": "[x, y, z]",
    "matrix": "[[…], […], […]]",
}
SERIES_BELOW = 0.25  # |w|² under which the series are used; their first dropped terms are below 3e-17 there


def hat(w: Array) -> Array:
    """[w], the 3×3 skew matrix with [w] x = w × x."""
    xp = namespace(w)
    zero = 0.0 * w[0]
    return xp.rows(
        [xp.vector(row) for row in ([zero, -w[2], w[1]], [w[2], zero, -w[0]], [-w[1], w[0], zero])]
    )


def vee(matrix: Array) -> Array:
    """The vector of the skew part: ``vee(hat(w)) = w``; a symmetric part is dropped."""
    m = matrix
    return 0.5 * namespace(m).vector([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])


def _series(x: Array, coefficients: list[float]) -> Array:
    value = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + x * value
    return value


def _coefficients(w: Array) -> tuple[Array, Array]:
    """sin a / a and (1 - cos a) / a² of the angle a = |w|."""
    xp = namespace(w)
    squared = dot(w, w)
    near = squared < SERIES_BELOW
    angle = xp.sqrt(xp.where(near, 1.0, squared))
    small = xp.where(near, squared, 0.0)  # keeps the series' own dead branch small
    terms = range(8)
    first = xp.where(
        near, _series(small, [(-1) ** k / factorial(2 * k + 1) for k in terms]), xp.sin(angle) / angle
    )
    # half angles: 1 - cos a would cancel
    half = xp.sin(0.5 * angle) / (0.5 * angle)
    second = xp.where(
        near, _series(small, [(-1) ** k / factorial(2 * k + 2) for k in terms]), 0.5 * half * half
    )
    return first, second


def exp(w: Array) -> Array:
    """The rotation by the vector w. [Rodrigues]"""
    first, second = _coefficients(w)
    skew = hat(w)
    return namespace(w).eye(3) + first * skew + second * (skew @ skew)


def angle(rotation: Array) -> Array:
    """Angle of rotation in [0, π]."""
    return namespace(rotation).atan2(norm(vee(rotation)), _cosine(rotation))


def _cosine(rotation: Array) -> Array:
    return 0.5 * (rotation[0, 0] + rotation[1, 1] + rotation[2, 2] - 1)


def log(rotation: Array) -> Array:
    """Rotation vector of R, |log R| < π: the paper's α/(2 sin α) (R - Rᵀ) as a vector.

    The angle comes from atan2(sin α, cos α), accurate from 0 to π; α/sin α is a series in sin²α near 0. Beyond a
    quarter turn the axis n is taken from R + Rᵀ = 2 cos α 1 + 2 (1 - cos α) n nᵀ: near π the skew part vanishes, and
    dividing it by sin α would lose 1 % of the Jacobian at π - 1e-7.

    Errors: with numbers, `OrientationAtPiError` where sin α < 1e-8 and cos α < 0; symbols cannot be checked.
    """
    xp = namespace(rotation)
    axis = vee(rotation)  # sin α times the unit axis
    squared, cosine = dot(axis, axis), _cosine(rotation)
    numbers = type(squared).__module__.partition(".")[0] != "casadi"
    if numbers and cosine < 0 and squared < 1e-16:
        raise OrientationAtPiError(
            f"the two orientations differ by {angle(rotation):.9f} rad, a half turn within 1e-8: the rotation error "
            f"has no unique axis at π = {pi:.9f}; turn the goal or the start by a small angle"
        )
    far = cosine < 0
    along = (0.5 * (rotation + rotation.T) - cosine * xp.eye(3)) @ axis  # (1 - cos α) sin α n
    direction = along / xp.sqrt(xp.where(far, dot(along, along), 1.0))
    beyond = xp.atan2(dot(axis, direction), cosine) * direction
    near = xp.where(far, 0.0, xp.where(squared < 1e-3, 1.0, 0.0)) > 0.5
    sine = xp.sqrt(xp.where(near, 1.0, xp.where(far, 1.0, squared)))
    series = _series(xp.where(near, squared, 0.0), ARCSINE)
    return xp.where(far, beyond, xp.where(near, series, xp.atan2(sine, cosine) / sine) * axis)


def cayley(c: Array) -> Array:
    """The rotation with Gibbs vector c = tan(α/2) × axis: rational in c, so cheaper to differentiate than `exp`."""
    xp, skew = namespace(c), hat(c)
    return xp.eye(3) + 2 / (1 + dot(c, c)) * (skew + skew @ skew)


def cayley_inverse(rotation: Array) -> Array:
    """The Gibbs vector of R; infinite at a half turn."""
    return 2 / (1 + rotation[0, 0] + rotation[1, 1] + rotation[2, 2]) * vee(rotation)


def between(origin: Array, direction: Array) -> Array:
    """The rotation vector of the shortest turn from one unit vector to another: φ n, perpendicular to both.

    Errors: with numbers, `OrientationAtPiError` where they are opposite and n is any perpendicular.
    """
    xp, axis = namespace(origin, direction), cross(origin, direction)
    squared, cosine = dot(axis, axis), dot(origin, direction)
    numbers = type(squared).__module__.partition(".")[0] != "casadi"
    if numbers and cosine < 0 and squared < 1e-16:
        raise OrientationAtPiError(
            "the two directions are opposite: the turn between them has no unique axis; change one by a small angle"
        )
    near = xp.where(cosine > 0, xp.where(squared < 1e-3, 1.0, 0.0), 0.0) > 0.5
    sine = xp.sqrt(xp.where(near, 1.0, squared))
    series = _series(xp.where(near, squared, 0.0), ARCSINE)
    return xp.where(near, series, xp.atan2(sine, cosine) / sine) * axis


def gibbs_between(origin: Array, direction: Array) -> Array:
    """tan(φ/2) n of the same turn: rational; infinite where the directions are opposite."""
    return cross(origin, direction) / (1 + dot(origin, direction))


def from_rpy(angles: Array) -> Array:
    """R = Rz(yaw) Ry(pitch) Rx(roll) of the angles (roll, pitch, yaw) [rad]. [Paper] section 4, RPY."""
    xp = namespace(angles)
    c1, c2, c3 = (xp.cos(angles[i]) for i in range(3))
    s1, s2, s3 = (xp.sin(angles[i]) for i in range(3))
    return xp.rows(
        [
            xp.vector(row)
            for row in (
                [c3 * c2, c3 * s2 * s1 - s3 * c1, c3 * s2 * c1 + s3 * s1],
                [s3 * c2, s3 * s2 * s1 + c3 * c1, s3 * s2 * c1 - c3 * s1],
                [-s2, c2 * s1, c2 * c1],
            )
        ]
    )


def to_rpy(rotation: Array) -> Array:
    """(roll, pitch, yaw) [rad] with `from_rpy(to_rpy(R)) = R`; at pitch = ±90° roll and yaw share one angle."""
    m, xp = rotation, namespace(rotation)
    cosine = xp.sqrt(m[2, 1] * m[2, 1] + m[2, 2] * m[2, 2])
    return xp.vector([xp.atan2(m[2, 1], m[2, 2]), xp.atan2(-m[2, 0], cosine), xp.atan2(m[1, 0], m[0, 0])])


def from_quaternion(quaternion: Array) -> Array:
    """Rotation of the unit quaternion (w, x, y, z)."""
    xp = namespace(quaternion)
    scalar = quaternion[0]
    skew = hat(quaternion[1:4])
    return xp.eye(3) + 2 * scalar * skew + 2 * (skew @ skew)


def to_quaternion(rotation: Array) -> Array:
    """The unit quaternion (w, x, y, z), w ≥ 0, of a rotation of numbers: of 4 q qᵀ the largest row. [Shepperd 1978]"""
    import numpy as np

    trace, vector = np.trace(rotation), 2.0 * vee(rotation)
    below = rotation + rotation.T + (1.0 - trace) * np.eye(3)
    products = np.block([[1.0 + trace, vector], [vector[:, None], below]])
    row = products[np.argmax(np.diag(products))]
    return np.asarray(np.copysign(1.0, row[0]) * row / np.linalg.norm(row))


def nearest(matrix: Array) -> Array:
    """The rotations nearest to matrices of numbers (…, 3, 3) in the Frobenius norm (their polar factors)."""
    import numpy as np

    left, _, right = svd(np.asarray(matrix, dtype=float))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return left @ right


def from_mapping(value: Mapping[str, Any]) -> Array:
    """Rotation written in exactly one of the `WRITINGS` (numbers).

    Errors: `InvalidProblemError`, its path the writing, where there are several or none, or a matrix or quaternion is
    more than `GROUP_TOLERANCE` off the group; one that is nearer is projected onto it.
    """
    import numpy as np

    ways = ", ".join(f"{name}: {form}" for name, form in WRITINGS.items())
    given = [name for name in WRITINGS if name in value]
    if len(given) != 1 or len(value) != 1:
        came = f"both {given[0]} and {given[1]}" if given[1:] else ", ".join(map(str, value)) or "no rotation"
        path = given[1] if given[1:] else None
        raise InvalidProblemError(
            f"{came}; expected exactly one of {ways}", path=path, at_key=bool(given[1:])
        )
    name = given[0]
    try:
        given_numbers = numbers_in(value[name])
        if np.asarray(given_numbers).dtype.kind in "bUS":
            raise ValueError
        numbers = np.array(given_numbers, dtype=float)
        shape = {"quaternion": (4,), "matrix": (3, 3)}.get(name, (3,))
        if numbers.shape != shape or not np.isfinite(numbers).all():
            raise ValueError
    except (TypeError, ValueError):
        words = f"expected finite numbers {WRITINGS[name]}, got {describe(value[name])}{degrees_hint(value[name])}"
        raise InvalidProblemError(words, path=name) from None
    makers = {"rpy": from_rpy, "quaternion": _of_quaternion, "rotvec": exp, "matrix": on_group}
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            rotation = makers[name](numbers)
    except InvalidProblemError as error:
        raise error.under(name) from None
    if not np.isfinite(rotation).all():
        raise InvalidProblemError("numbers too large for a rotation", path=name)
    return rotation


def _of_quaternion(quaternion: Array) -> Array:
    size = float(norm(quaternion))
    if abs(size - 1) > GROUP_TOLERANCE:
        near = f"; write [{', '.join(f'{x / size:.9g}' for x in quaternion)}]" if size > 1e-6 else ""
        raise InvalidProblemError(
            f"its norm {size:.9g} is off by {abs(size - 1):.2g}; expected a unit quaternion [w, x, y, z]{near}"
        )
    return from_quaternion(quaternion / size)


def on_group(matrix: Array) -> Array:
    """The rotation nearest to a matrix of numbers that is one within `GROUP_TOLERANCE`; one to rounding stays as it is.

    Errors: `InvalidProblemError` for other matrices.
    """
    import numpy as np

    with np.errstate(over="ignore", invalid="ignore"):
        off = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
        determinant = float(np.linalg.det(matrix))
    if off <= 10 * GROUP_TOLERANCE and determinant < 0:
        raise InvalidProblemError(f"a reflection, det R = {determinant:.6g}; expected a rotation, det R = 1")
    if off <= 10 * GROUP_TOLERANCE:  # near enough for its nearest rotation to mean something
        rotation = matrix if off <= ROUNDED else nearest(matrix)
        off = float(np.abs(matrix - rotation).max())
        if off <= GROUP_TOLERANCE:
            return rotation
    raise InvalidProblemError(
        f"no rotation matrix: RᵀR is off the unit matrix by {off:.2g}, det R = {determinant:.6g}; "
        "expected the rows of a rotation, or rpy: [roll, pitch, yaw]"
    )
