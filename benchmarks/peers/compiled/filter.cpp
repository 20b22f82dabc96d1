// The filter of `by_hand.py` line by line in C++ on Eigen's matrices of fixed size.
#include <cmath>

#include <Eigen/Dense>

#include "filter.h"

using Eigen::Map, Eigen::RowMajor;
using V3 = Eigen::Vector3d;
using M3 = Eigen::Matrix3d;
using M6 = Eigen::Matrix<double, 6, 6>;
template <int rows, int columns>
using Rows = Eigen::Matrix<double, rows, columns, RowMajor>;

static V3 closed_form(const Filter &f, const double *spots) {
    V3 u[3], p, old = V3::Zero();
    double depth[3] = {1.0, 1.0, 1.0}, k = 2.0 * f.half_spacing / f.distance;
    for (int i = 0; i < 3; i++) u[i] = V3(spots[2 * i], spots[2 * i + 1], f.focal).normalized();
    V3 w = (u[0] + u[1]).normalized();
    for (int pass = 0; pass < PASSES; pass++) {
        V3 v[3];
        for (int i = 0; i < 3; i++) v[i] = u[i] * (depth[i] / u[i].dot(w));
        V3 middle = 0.5 * (v[0] + v[1]), d = v[0] - v[1], c = v[2] - middle;
        d -= w * d.dot(w);
        c -= w * c.dot(w);
        double square = d.squaredNorm(), t = k * c.dot(d) / square, up = k * w.dot(d.cross(c)) / square;
        double m = 1.0 + t * t + up * up, q = up / m, z = 2.0 * q / (1.0 + std::sqrt(1.0 - 4.0 * q * q));
        double weight = (1.0 + z * z) / m, x = std::sqrt(weight - z * z);
        double r = 2.0 * f.half_spacing * std::sqrt(weight / square);
        p = r * V3(x, -t * weight / x, z);
        if ((p - old).cwiseAbs().maxCoeff() < 1e-9 * r) break;
        old = p;
        w = middle.normalized();
        for (int i = 0; i < 3; i++) depth[i] = 1.0 - Map<const V3>(f.beacons[i]).dot(p) / (r * r);
    }
    return p;
}

static V3 angles(const V3 &p) {
    return V3(p.norm(), std::atan2(p[1], p[0]), std::atan2(-p[2], p.head<2>().norm()));
}

static M3 angles_jacobian(const V3 &p) {
    double x = p[0], y = p[1], z = p[2], h2 = x * x + y * y, h = std::sqrt(h2), r2 = h2 + z * z, r = std::sqrt(r2);
    M3 j;
    j << x / r, y / r, z / r, -y / h2, x / h2, 0.0, x * z / (h * r2), y * z / (h * r2), -h / r2;
    return j;
}

static M3 noise(const Filter &f, const V3 &p, const M3 &jacobian) {
    M6 full;
    M3 turned = Map<const Rows<3, 3>>(f.cam_from_dock[0]);
    for (int i = 0; i < 3; i++) {
        V3 c = turned * (Map<const V3>(f.beacons[i]) - p);
        Eigen::Matrix<double, 2, 3> project;
        project << 1.0, 0.0, -c[0] / c[2], 0.0, 1.0, -c[1] / c[2];
        project *= f.focal / c[2];
        M3 turn;
        turn << 0.0, c[2], -c[1], -c[2], 0.0, c[0], c[1], -c[0], 0.0;
        full.block<2, 3>(2 * i, 0) = -project * turned;
        full.block<2, 3>(2 * i, 3) = project * turn;
    }
    Eigen::Matrix<double, 3, 6> j = jacobian * full.inverse().topRows<3>();
    return f.sigma * f.sigma * j * j.transpose();
}

// One epoch: predict with an acceleration, gate, update, and write range, state and covariance.
extern "C" void one_epoch(Filter *f, const double *spots, const double *push, double *answer) {
    M6 phi = Map<const Rows<6, 6>>(f->phi[0]), p = Map<const Rows<6, 6>>(f->p[0]);
    Eigen::Matrix<double, 6, 1> x = phi * Map<const Eigen::Matrix<double, 6, 1>>(f->x);
    x += Map<const Rows<6, 3>>(f->effect[0]) * Map<const V3>(push);
    p = phi * p * phi.transpose() + Map<const Rows<6, 6>>(f->q[0]);
    M3 dock = Map<const Rows<3, 3>>(f->dock[0]);
    V3 at = dock * x.head<3>(), y = angles(closed_form(*f, spots)) - angles(at);
    y[1] = std::remainder(y[1], 2.0 * M_PI);
    y[2] = std::remainder(y[2], 2.0 * M_PI);
    M3 jacobian = angles_jacobian(at), r = noise(*f, at, jacobian);
    Eigen::Matrix<double, 3, 6> h = Eigen::Matrix<double, 3, 6>::Zero();
    h.leftCols<3>() = jacobian * dock;
    Eigen::Matrix<double, 6, 3> ph = p * h.transpose();
    M3 inverse = (h * ph + r).inverse();
    if (y.dot(inverse * y) <= f->gate) {
        Eigen::Matrix<double, 6, 3> gain = ph * inverse;
        M6 rest = M6::Identity() - gain * h;
        x += gain * y;
        p = rest * p * rest.transpose() + gain * r * gain.transpose();
    }
    answer[0] = x.head<3>().norm();
    Map<Eigen::Matrix<double, 6, 1>>(f->x) = Map<Eigen::Matrix<double, 6, 1>>(answer + 1) = x;
    Map<Rows<6, 6>>(f->p[0]) = Map<Rows<6, 6>>(answer + 7) = p;
}

extern "C" void many_epochs(Filter *f, long n, const double *spots, const double *push, double *answers) {
    for (long e = 0; e < n; e++) one_epoch(f, spots + 6 * e, push + 3 * e, answers + ANSWER * e);
}
