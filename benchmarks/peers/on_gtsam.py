"""The filter of `by_hand` on GTSAM: its Kalman filter, and its fixed-lag smoother, read at the newest epoch.

GTSAM's extended filters in Python know poses and points, not position and velocity; so each image is linearised about
the prediction with numpy, as for the others, and handed over as rows.
"""

import numpy as np

LAG_S, STEP_S = 1.0, 0.1
VARIANCE_BOUND = 2e-4
"""Of the smoother's covariances, relative: its variances of velocity agree to 1e-4 where all else agrees to 1e-6."""


class OnKalmanFilter:
    """GTSAM's KalmanFilter, a Gaussian density from epoch to epoch."""

    def __init__(self, start):
        """Start the filter."""
        import gtsam

        self.start, self.filter = start, gtsam.KalmanFilter(6)
        self.density = self.filter.init(start.x, start.covariance)

    def step(self, spots, acceleration):
        """Range, state, covariance after one image."""
        start = self.start
        predicted = self.filter.predictQ(self.density, start.phi, start.effect, acceleration, start.q)
        x, covariance = predicted.mean(), predicted.covariance()
        y, h, r = start.seen(x, spots)
        self.density = predicted
        if y @ np.linalg.solve(h @ covariance @ h.T + r, y) <= start.gate:
            self.density = self.filter.updateQ(predicted, h, y + h @ x, r)
            x, covariance = self.density.mean(), self.density.covariance()
        return np.linalg.norm(x[:3]), x, covariance


class OnFixedLag:
    """GTSAM's IncrementalFixedLagSmoother: the last second of states is solved for together at every epoch."""

    def __init__(self, start):
        """Start with a prior on the first state."""
        import gtsam

        self.gtsam, self.start, self.epoch = gtsam, start, 0
        parameters, exact = gtsam.ISAM2Params(), gtsam.ISAM2GaussNewtonParams()
        exact.setWildfireThreshold(0.0)  # else it leaves changes below 1e-3 out
        parameters.setOptimizationParams(exact)
        parameters.setFactorization("QR")  # its faster Cholesky finds this noise of the motion too small to solve
        self.smoother = gtsam.IncrementalFixedLagSmoother(LAG_S, parameters)
        self.motion, self.unit = self.whitening(start.q), gtsam.noiseModel.Unit.Create
        self.x, self.covariance = start.x, start.covariance
        prior = gtsam.PriorFactorVector(0, start.x, gtsam.noiseModel.Gaussian.Covariance(start.covariance))
        self.solve([prior], start.x)

    def whitening(self, covariance):
        """What makes a noise white: GTSAM's rows in Python take no correlated one."""
        return self.gtsam.noiseModel.Gaussian.Covariance(covariance).R()

    def solve(self, factors, guess):
        """Hand over factors and a guess of the newest state, and read it."""
        graph, values = self.gtsam.NonlinearFactorGraph(), self.gtsam.Values()
        for factor in factors:
            graph.push_back(factor)
        values.insert(self.epoch, guess)
        self.smoother.update(graph, values, {self.epoch: STEP_S * self.epoch})
        self.x = self.smoother.calculateEstimateVector(self.epoch)
        self.covariance = self.smoother.marginalCovariance(self.epoch)

    def step(self, spots, acceleration):
        """Range, state, covariance after one image."""
        gtsam, start = self.gtsam, self.start
        push = start.effect @ acceleration
        x, covariance = start.phi @ self.x + push, start.phi @ self.covariance @ start.phi.T + start.q
        y, h, r = start.seen(x, spots)
        self.epoch += 1
        white = self.motion
        before, after = (self.epoch - 1, -white @ start.phi), (self.epoch, white)
        factors = [gtsam.JacobianFactor(*before, *after, white @ push, self.unit(6))]
        if y @ np.linalg.solve(h @ covariance @ h.T + r, y) <= start.gate:
            white = self.whitening(r)
            factors.append(gtsam.JacobianFactor(self.epoch, white @ h, white @ (y + h @ x), self.unit(3)))
        zeros = gtsam.Values()  # what the rows are about: the states themselves, not corrections
        for key in (self.epoch - 1, self.epoch):
            zeros.insert(key, np.zeros(6))
        self.solve([gtsam.LinearContainerFactor(rows, zeros) for rows in factors], x)
        return np.linalg.norm(self.x[:3]), self.x, self.covariance
