"""The filter of `by_hand` in JAX, compiled by it, in doubles: an epoch a call, and a whole log as one `lax.scan`."""

import numpy as np


class OnJax:
    """Functions compiled for one start."""

    def __init__(self, start):
        """Compile nothing yet: the first call does."""
        import jax

        jax.config.update("jax_enable_x64", True)
        self.start, self.epoch = start, jax.jit(epoch_of(start))

        def after(carry, seen):
            answer = self.epoch(*carry, *seen)
            return answer[1:], answer

        self.log = jax.jit(lambda carry, images: jax.lax.scan(after, carry, images))
        self.restart()

    def restart(self):
        """Begin again."""
        import jax.numpy as jnp

        self.x, self.covariance = jnp.asarray(self.start.x), jnp.asarray(self.start.covariance)
        return self

    def step(self, spots, acceleration):
        """Range, state, covariance after one image."""
        distance, self.x, self.covariance = self.epoch(self.x, self.covariance, spots, acceleration)
        return float(distance), np.asarray(self.x), np.asarray(self.covariance)

    def scan(self, spots, accelerations):
        """Ranges (n,), states (n, 6), covariances (n, 6, 6) of images (n, 3, 2)."""
        _, answers = self.log((self.start.x, self.start.covariance), (spots, accelerations))
        return tuple(map(np.asarray, answers))


def epoch_of(start):
    """Function of state, covariance, image and acceleration: range, state and covariance after it."""
    import jax.numpy as jnp

    hand = start.hand
    phi, q, effect = map(jnp.asarray, (start.phi, start.q, start.effect))
    dock, spin = jnp.asarray(hand.dock), jnp.zeros((3, 3))

    def epoch(x, covariance, spots, acceleration):
        x, covariance = phi @ x + effect @ acceleration, phi @ covariance @ phi.T + q
        p = dock @ x[:3]
        jacobian = angles_jacobian(jnp, p)
        y = angles(jnp, closed_form(hand, spots)) - angles(jnp, p)
        y = y.at[1:].set((y[1:] + jnp.pi) % (2.0 * jnp.pi) - jnp.pi)
        h, r = jnp.hstack([jacobian @ dock, spin]), noise(hand, p, jacobian)
        inverse = jnp.linalg.inv(h @ covariance @ h.T + r)
        gain = covariance @ h.T @ inverse
        rest = jnp.eye(6) - gain @ h
        passed = y @ inverse @ y <= start.gate
        x = jnp.where(passed, x + gain @ y, x)
        covariance = jnp.where(passed, rest @ covariance @ rest.T + gain @ r @ gain.T, covariance)
        return jnp.linalg.norm(x[:3]), x, covariance

    return epoch


def closed_form(hand, spots):
    """As in `ByHand.closed_form`."""
    import jax
    import jax.numpy as jnp

    u = jnp.column_stack([spots, jnp.full(3, hand.f)])
    u = u / jnp.linalg.norm(u, axis=1)[:, None]
    w = u[0] + u[1]
    beacons, k = jnp.asarray(hand.beacons), 2.0 * hand.a / hand.b

    def once(state):
        _, old, w, depth, passes = state
        v = u * (depth / (u @ w))[:, None]
        middle = 0.5 * (v[0] + v[1])
        d, c = v[0] - v[1], v[2] - middle
        d, c = d - w * (d @ w), c - w * (c @ w)
        square = d @ d
        t, up = k * (c @ d) / square, k * (w @ jnp.cross(d, c)) / square
        m = 1.0 + t * t + up * up
        q = up / m
        z = 2.0 * q / (1.0 + jnp.sqrt(1.0 - 4.0 * q * q))
        weight = (1.0 + z * z) / m
        x = jnp.sqrt(weight - z * z)
        r = 2.0 * hand.a * jnp.sqrt(weight / square)
        p = r * jnp.stack([x, -t * weight / x, z])
        again = jnp.abs(p - old).max() >= 1e-9 * r
        return again, p, middle / jnp.linalg.norm(middle), 1.0 - (beacons @ p) / (r * r), passes + 1

    state = True, jnp.zeros(3), w / jnp.linalg.norm(w), jnp.ones(3), 0
    return jax.lax.while_loop(lambda state: state[0] & (state[-1] < 40), once, state)[1]


def angles(jnp, p):
    """Range, azimuth, elevation."""
    horizontal = jnp.hypot(p[0], p[1])
    return jnp.stack([jnp.hypot(horizontal, p[2]), jnp.arctan2(p[1], p[0]), jnp.arctan2(-p[2], horizontal)])


def angles_jacobian(jnp, p):
    """Their derivative."""
    x, y, z = p
    h2 = x * x + y * y
    h, r2 = jnp.sqrt(h2), h2 + z * z
    r = jnp.sqrt(r2)
    rows = [x / r, y / r, z / r, -y / h2, x / h2, 0.0 * x, x * z / (h * r2), y * z / (h * r2), -h / r2]
    return jnp.stack(rows).reshape(3, 3)


def noise(hand, p, jacobian):
    """As in `ByHand.noise`, the three beacons at once."""
    import jax.numpy as jnp

    turned = jnp.asarray(hand.cam_from_dock)
    x, y, z = turned @ (jnp.asarray(hand.beacons) - p).T
    scale, right, up = (hand.f / z)[:, None, None], x / z, y / z
    shift = -scale * (turned[:2] - jnp.stack([right, up], axis=1)[:, :, None] * turned[2])
    twist = jnp.stack([-right * y, z + right * x, -y, -z - up * y, up * x, x], axis=1).reshape(3, 2, 3)
    full = jnp.concatenate([shift, scale * twist], axis=2).reshape(6, 6)
    j = jacobian @ jnp.linalg.inv(full)[:3]
    return hand.s**2 * j @ j.T
