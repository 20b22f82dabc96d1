"""The attitude that fits a frame's matches best, with the fold known up to an error.

A star of field 1 is seen along s = M u, and M is known up to a small turn: the true direction is w + phi x w, phi with
covariance P ("slip"). Its residual then does not tell the attitude's error d but d + phi, so that a frame holds two
attitudes, one seen by each field, that differ by phi. With the information F0, F1 and the gradients g0, g1 of the two

    F = F0 + (F1^-1 + P)^-1,    d = F^-1 (g0 + (I + F1 P)^-1 g1),    (F1^-1 + P)^-1 = (I + F1 P)^-1 F1

is what is known of d after phi is eliminated (the marginal of the joint normal equations), and the same with 0 and 1
exchanged of d + phi. The difference of both is the estimate of phi.
"""

from relnav.arrays import Codes, Matrix, Vector
from relnav.codegen.kernel import kernel
from relnav.geometry.linear_algebra import invert_three
from relnav.sensors.dual_field.matching import (
    GRADIENT,
    INFORMATION,
    PRIOR,
    SCRATCH,
    SECOND,
    SHIFT,
    STEP,
    Frame,
    aberrate_into,
    tight_chord2,
    turn,
)
from relnav.sensors.dual_field.sky import SkyArrays


@kernel
def fit_attitude(frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, cov: Matrix, passes: int, v: Vector) -> bool:
    """Improve A (3, 3) over all matches by Gauss-Newton and write its covariance (3, 3); False where singular.

    Writes the fold's error and the covariance of what field 1 sees into `Frame.slip`. v (3,) is scratch.
    """
    slip = frame.slip
    prior, shift, second = slip[PRIOR : PRIOR + 3], slip[SHIFT], slip[SECOND : SECOND + 3]
    F0, F1 = slip[INFORMATION : INFORMATION + 3], slip[INFORMATION + 3 : INFORMATION + 6]
    g, d, work = slip[GRADIENT : GRADIENT + 2], slip[STEP : STEP + 2], slip[SCRATCH : SCRATCH + 6]
    for _ in range(passes):
        gather_field(frame, sky, match, A, 0, F0, g[0], v)
        if frame.fields == 1:
            if not invert_three(F0, cov):
                return False
            for r in range(3):
                d[0, r] = cov[r, 0] * g[0, 0] + cov[r, 1] * g[0, 1] + cov[r, 2] * g[0, 2]
        else:
            gather_field(frame, sky, match, A, 1, F1, g[1], v)
            if not join(F0, F1, g[0], g[1], prior, cov, d[0], work):
                return False
            if not join(F1, F0, g[1], g[0], prior, second, d[1], work):
                return False
            for r in range(3):
                shift[r] = d[1, r] - d[0, r]
        turn(A, d[0, 0], d[0, 1], d[0, 2])
    return True


@kernel
def gather_field(
    frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, field: int, F: Matrix, g: Vector, v: Vector
) -> None:
    """Write information F (3, 3) and gradient g (3,) of one field's matches at A.

    With q = A v and the error d of A the residual w - q - q x d is smallest for d = F^-1 g, g = sum (w x q) / sigma^2,
    F = sum (I - q q^T) / sigma^2. Where a spot has its own information P, g = sum (P (w - q)) x q and F = sum
    [q x]^T P [q x].
    """
    W, n = frame.W, frame.sigma2.shape[0]
    f00, f01, f02, f11, f12, f22, g0, g1, g2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        if match[k, 0] < 0 or match[k, 1] != field:
            continue
        row, star = field * n + k, sky.stars[match[k, 0]]
        aberrate_into(star[0], star[1], star[2], frame.beta, 1.0, v)
        q0 = A[0, 0] * v[0] + A[0, 1] * v[1] + A[0, 2] * v[2]
        q1 = A[1, 0] * v[0] + A[1, 1] * v[1] + A[1, 2] * v[2]
        q2 = A[2, 0] * v[0] + A[2, 1] * v[1] + A[2, 2] * v[2]
        if frame.information.shape[0] > 0:
            P = frame.information[row]
            a0, a1, a2 = P[2] * q1 - P[1] * q2, P[0] * q2 - P[2] * q0, P[1] * q0 - P[0] * q1  # rows of P [q x]^T
            b0, b1, b2 = P[4] * q1 - P[3] * q2, P[1] * q2 - P[4] * q0, P[3] * q0 - P[1] * q1
            c0, c1, c2 = P[5] * q1 - P[4] * q2, P[2] * q2 - P[5] * q0, P[4] * q0 - P[2] * q1
            r0, r1, r2 = W[row, 0] - q0, W[row, 1] - q1, W[row, 2] - q2
            f00, f01, f02 = f00 + q1 * c0 - q2 * b0, f01 + q1 * c1 - q2 * b1, f02 + q1 * c2 - q2 * b2
            f11, f12, f22 = f11 + q2 * a1 - q0 * c1, f12 + q2 * a2 - q0 * c2, f22 + q0 * b2 - q1 * a2
            g0 -= a0 * r0 + b0 * r1 + c0 * r2
            g1 -= a1 * r0 + b1 * r1 + c1 * r2
            g2 -= a2 * r0 + b2 * r1 + c2 * r2
            continue
        p = 1.0 / frame.sigma2[k]
        f00, f01, f02 = f00 + p * (1.0 - q0 * q0), f01 - p * q0 * q1, f02 - p * q0 * q2
        f11, f12, f22 = f11 + p * (1.0 - q1 * q1), f12 - p * q1 * q2, f22 + p * (1.0 - q2 * q2)
        g0 += p * (W[row, 1] * q2 - W[row, 2] * q1)
        g1 += p * (W[row, 2] * q0 - W[row, 0] * q2)
        g2 += p * (W[row, 0] * q1 - W[row, 1] * q0)
    F[0, 0], F[0, 1], F[0, 2] = f00, f01, f02
    F[1, 0], F[1, 1], F[1, 2] = f01, f11, f12
    F[2, 0], F[2, 1], F[2, 2] = f02, f12, f22
    g[0], g[1], g[2] = g0, g1, g2


@kernel
def join(Fa: Matrix, Fb: Matrix, ga: Vector, gb: Vector, prior: Matrix, cov: Matrix, d: Vector, work: Matrix) -> bool:
    """Write cov = (Fa + (I + Fb P)^-1 Fb)^-1 and d = cov (ga + (I + Fb P)^-1 gb); False where singular.

    work (6, 3) is scratch.
    """
    K, total = work[0:3], work[3:6]
    for r in range(3):
        for c in range(3):
            K[r, c] = Fb[r, 0] * prior[0, c] + Fb[r, 1] * prior[1, c] + Fb[r, 2] * prior[2, c]
        K[r, r] += 1.0
    if not invert_three(K, K):
        return False
    for r in range(3):
        for c in range(3):
            total[r, c] = Fa[r, c] + K[r, 0] * Fb[0, c] + K[r, 1] * Fb[1, c] + K[r, 2] * Fb[2, c]
    if not invert_three(total, cov):
        return False
    for r in range(3):
        total[0, r] = ga[r] + K[r, 0] * gb[0] + K[r, 1] * gb[1] + K[r, 2] * gb[2]
    for r in range(3):
        for c in range(r):  # rounding of K alone
            cov[r, c] = cov[c, r] = 0.5 * (cov[r, c] + cov[c, r])
    for r in range(3):
        d[r] = cov[r, 0] * total[0, 0] + cov[r, 1] * total[0, 1] + cov[r, 2] * total[0, 2]
    return True


@kernel
def forget_slip(frame: Frame, cov: Matrix) -> None:
    """For an attitude (cov) that no frame has fitted: the fold's error is as before, and adds to what field 1 sees."""
    slip = frame.slip
    for r in range(3):
        slip[SHIFT, r] = 0.0
        for c in range(3):
            slip[SECOND + r, c] = cov[r, c] + slip[PRIOR + r, c]


@kernel
def agree_on_fold(frame: Frame, sky: SkyArrays, match: Codes, A: Matrix, cov: Matrix, own: int, v: Vector) -> None:
    """Of the other field's matches keep those that one error of the fold explains, the most that agree.

    The fold's error makes the first look into the other field a wide one, and chance puts a star there now and then.
    Each match by itself says what the error is; the others then fall on their stars or not.
    """
    n, other = frame.sigma2.shape[0], 1 - own
    trial = frame.slip[SCRATCH + 6 : SCRATCH + 9]
    total, best, chosen = 0, 0, -1
    for k in range(n):
        total += match[k, 0] >= 0 and match[k, 1] == other
    for k in range(n + 1):
        last = k == n or 2 * best > total  # the last pass puts the best one's back
        pick = chosen if last else k
        if pick < 0:
            return
        if match[pick, 1] != other or match[pick, 0] == -1:
            continue
        for q in range(n):  # a star that is set aside is kept as -2 - star
            if match[q, 1] == other and match[q, 0] >= 0 and q != pick:
                match[q, 0] = -2 - match[q, 0]
        for r in range(3):
            for c in range(3):
                trial[r, c] = A[r, c]
        fits = fit_attitude(frame, sky, match, trial, cov, 2, v)
        agreed = 1
        for q in range(n):
            if match[q, 0] < -1:
                match[q, 0] = -2 - match[q, 0]
                near = fits and miss2(frame, sky, q, match, trial, v) < tight_chord2(frame, q, other, cov)
                agreed += near
                if last and not near:
                    match[q, 0] = -1
        if last:
            return
        if fits and agreed > best:
            best, chosen = agreed, k


@kernel
def miss2(frame: Frame, sky: SkyArrays, k: int, match: Codes, A: Matrix, v: Vector) -> float:
    """Square of the distance of spot k from its star, the fold's error counted; writes what it is along into v (3,)."""
    f, star = match[k, 1], sky.stars[match[k, 0]]
    w = frame.W[f * frame.sigma2.shape[0] + k]
    aberrate_into(star[0], star[1], star[2], frame.beta, 1.0, v)
    x, y, z, total = v[0], v[1], v[2], 0.0
    for r in range(3):
        moved = 0.0
        if f == 1:
            s = frame.slip[SHIFT]
            moved = s[(r + 1) % 3] * w[(r + 2) % 3] - s[(r + 2) % 3] * w[(r + 1) % 3]
        v[r] = w[r] + moved - A[r, 0] * x - A[r, 1] * y - A[r, 2] * z
        total += v[r] ** 2
    return total


@kernel
def misfit(frame: Frame, k: int, field: int, d: Vector, d2: float) -> float:
    """Square of the distance d (3,) of a spot from its star, d2 its length's square, in units of its covariance."""
    if frame.information.shape[0] == 0:
        return float(d2 / frame.sigma2[k])
    P = frame.information[field * frame.sigma2.shape[0] + k]
    return float(
        P[0] * d[0] * d[0]
        + P[3] * d[1] * d[1]
        + P[5] * d[2] * d[2]
        + 2.0 * (P[1] * d[0] * d[1] + P[2] * d[0] * d[2] + P[4] * d[1] * d[2])
    )
