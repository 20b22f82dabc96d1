/* The filter of `by_hand.py` line by line in plain C: what a compiler makes of it is what Python can at best reach. */
#include <math.h>
#include <string.h>

#include "filter.h"

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void closed_form(const Filter *f, const double spots[6], double p[3]) {
    double u[3][3], w[3], depth[3] = {1.0, 1.0, 1.0}, old[3] = {0.0, 0.0, 0.0};
    double k = 2.0 * f->half_spacing / f->distance;
    for (int i = 0; i < 3; i++) {
        double x = spots[2 * i], y = spots[2 * i + 1], length = sqrt(x * x + y * y + f->focal * f->focal);
        u[i][0] = x / length, u[i][1] = y / length, u[i][2] = f->focal / length;
    }
    for (int j = 0; j < 3; j++) w[j] = u[0][j] + u[1][j];
    double norm = sqrt(dot(w, w));
    for (int j = 0; j < 3; j++) w[j] /= norm;
    for (int pass = 0; pass < PASSES; pass++) {
        double v[3][3], middle[3], d[3], c[3], moved = 0.0;
        for (int i = 0; i < 3; i++) {
            double far = depth[i] / dot(u[i], w);
            for (int j = 0; j < 3; j++) v[i][j] = u[i][j] * far;
        }
        for (int j = 0; j < 3; j++) {
            middle[j] = 0.5 * (v[0][j] + v[1][j]);
            d[j] = v[0][j] - v[1][j], c[j] = v[2][j] - middle[j];
        }
        double along_d = dot(d, w), along_c = dot(c, w);
        for (int j = 0; j < 3; j++) d[j] -= w[j] * along_d, c[j] -= w[j] * along_c;
        double cross[3] = {d[1] * c[2] - d[2] * c[1], d[2] * c[0] - d[0] * c[2], d[0] * c[1] - d[1] * c[0]};
        double square = dot(d, d), t = k * dot(c, d) / square, up = k * dot(w, cross) / square;
        double m = 1.0 + t * t + up * up, q = up / m, z = 2.0 * q / (1.0 + sqrt(1.0 - 4.0 * q * q));
        double weight = (1.0 + z * z) / m, x = sqrt(weight - z * z);
        double r = 2.0 * f->half_spacing * sqrt(weight / square);
        p[0] = r * x, p[1] = -r * t * weight / x, p[2] = r * z;
        for (int j = 0; j < 3; j++) moved = fmax(moved, fabs(p[j] - old[j]));
        if (moved < 1e-9 * r) break;
        norm = sqrt(dot(middle, middle));
        for (int j = 0; j < 3; j++) old[j] = p[j], w[j] = middle[j] / norm;
        for (int i = 0; i < 3; i++) depth[i] = 1.0 - dot(f->beacons[i], p) / (r * r);
    }
}

static void angles(const double p[3], double z[3]) {
    double horizontal = sqrt(p[0] * p[0] + p[1] * p[1]);
    z[0] = sqrt(dot(p, p)), z[1] = atan2(p[1], p[0]), z[2] = atan2(-p[2], horizontal);
}

static void angles_jacobian(const double p[3], double j[3][3]) {
    double x = p[0], y = p[1], z = p[2], h2 = x * x + y * y, h = sqrt(h2), r2 = h2 + z * z, r = sqrt(r2);
    double rows[3][3] = {{x / r, y / r, z / r}, {-y / h2, x / h2, 0.0}, {x * z / (h * r2), y * z / (h * r2), -h / r2}};
    memcpy(j, rows, sizeof rows);
}

/* The first three rows of the inverse of m, by elimination with pivots. */
static void invert(double m[6][6], double inverse[3][6]) {
    double right[6][6] = {{0}};
    for (int i = 0; i < 6; i++) right[i][i] = 1.0;
    for (int c = 0; c < 6; c++) {
        int best = c;
        for (int i = c + 1; i < 6; i++)
            if (fabs(m[i][c]) > fabs(m[best][c])) best = i;
        for (int j = 0; best != c && j < 6; j++) {
            double t = m[c][j], s = right[c][j];
            m[c][j] = m[best][j], m[best][j] = t, right[c][j] = right[best][j], right[best][j] = s;
        }
        double scale = 1.0 / m[c][c];
        for (int j = 0; j < 6; j++) m[c][j] *= scale, right[c][j] *= scale;
        for (int i = 0; i < 6; i++) {
            double g = m[i][c];
            for (int j = 0; i != c && j < 6; j++) m[i][j] -= g * m[c][j], right[i][j] -= g * right[c][j];
        }
    }
    memcpy(inverse, right, 18 * sizeof(double));
}

static void noise(const Filter *f, const double p[3], double jacobian[3][3], double r[3][3]) {
    double full[6][6], inverse[3][6], a[3][6];
    for (int i = 0; i < 3; i++) {
        double d[3], c[3];
        for (int j = 0; j < 3; j++) d[j] = f->beacons[i][j] - p[j];
        for (int j = 0; j < 3; j++) c[j] = dot(f->cam_from_dock[j], d);
        double g = f->focal / c[2], turn[3][3] = {{0.0, c[2], -c[1]}, {-c[2], 0.0, c[0]}, {c[1], -c[0], 0.0}};
        double project[2][3] = {{g, 0.0, -g * c[0] / c[2]}, {0.0, g, -g * c[1] / c[2]}};
        for (int row = 0; row < 2; row++)
            for (int j = 0; j < 3; j++) {
                double shift = 0.0, twist = 0.0;
                for (int k = 0; k < 3; k++)
                    shift -= project[row][k] * f->cam_from_dock[k][j], twist += project[row][k] * turn[k][j];
                full[2 * i + row][j] = shift, full[2 * i + row][3 + j] = twist;
            }
    }
    invert(full, inverse);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 6; j++)
            a[i][j] = jacobian[i][0] * inverse[0][j] + jacobian[i][1] * inverse[1][j] + jacobian[i][2] * inverse[2][j];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0.0;
            for (int k = 0; k < 6; k++) sum += a[i][k] * a[j][k];
            r[i][j] = f->sigma * f->sigma * sum;
        }
}

static void predict(Filter *f, const double push[3]) {
    double x[6], half[6][6];
    for (int i = 0; i < 6; i++) {
        x[i] = dot(f->effect[i], push);
        for (int k = 0; k < 6; k++) x[i] += f->phi[i][k] * f->x[k];
        for (int j = 0; j < 6; j++) {
            half[i][j] = 0.0;
            for (int k = 0; k < 6; k++) half[i][j] += f->phi[i][k] * f->p[k][j];
        }
    }
    memcpy(f->x, x, sizeof x);
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double sum = f->q[i][j];
            for (int k = 0; k < 6; k++) sum += half[i][k] * f->phi[j][k];
            f->p[i][j] = sum;
        }
}

static void invert3(double m[3][3], double o[3][3]) {
    double a = m[1][1] * m[2][2] - m[1][2] * m[2][1], b = m[1][2] * m[2][0] - m[1][0] * m[2][2];
    double c = m[1][0] * m[2][1] - m[1][1] * m[2][0], d = 1.0 / (m[0][0] * a + m[0][1] * b + m[0][2] * c);
    o[0][0] = a * d, o[1][0] = b * d, o[2][0] = c * d;
    o[0][1] = (m[0][2] * m[2][1] - m[0][1] * m[2][2]) * d, o[0][2] = (m[0][1] * m[1][2] - m[0][2] * m[1][1]) * d;
    o[1][1] = (m[0][0] * m[2][2] - m[0][2] * m[2][0]) * d, o[1][2] = (m[0][2] * m[1][0] - m[0][0] * m[1][2]) * d;
    o[2][1] = (m[0][1] * m[2][0] - m[0][0] * m[2][1]) * d, o[2][2] = (m[0][0] * m[1][1] - m[0][1] * m[1][0]) * d;
}

/* Joseph's form: P = (I - K H) P (I - K H)^T + K R K^T. */
static void joseph(Filter *f, double gain[6][3], double h[3][3], double r[3][3]) {
    double rest[6][6], half[6][6], noisy[6][3];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            rest[i][j] = i == j;
            for (int k = 0; j < 3 && k < 3; k++) rest[i][j] -= gain[i][k] * h[k][j];
        }
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 6; j++) {
            half[i][j] = 0.0;
            for (int k = 0; k < 6; k++) half[i][j] += rest[i][k] * f->p[k][j];
        }
        for (int j = 0; j < 3; j++) noisy[i][j] = dot(gain[i], r[j]);
    }
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 6; j++) {
            double sum = dot(noisy[i], gain[j]);
            for (int k = 0; k < 6; k++) sum += half[i][k] * rest[j][k];
            f->p[i][j] = sum;
        }
}

static void update(Filter *f, const double spots[6]) {
    double fix[3], z[3], y[3], p[3], predicted[3], jacobian[3][3], r[3][3], h[3][3], ph[6][3], s[3][3], inverse[3][3];
    closed_form(f, spots, fix);
    angles(fix, z);
    for (int i = 0; i < 3; i++) p[i] = dot(f->dock[i], f->x);
    angles(p, predicted);
    angles_jacobian(p, jacobian);
    noise(f, p, jacobian, r);
    for (int i = 0; i < 3; i++) y[i] = i == 0 ? z[i] - predicted[i] : remainder(z[i] - predicted[i], 2.0 * M_PI);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            h[i][j] = jacobian[i][0] * f->dock[0][j] + jacobian[i][1] * f->dock[1][j] + jacobian[i][2] * f->dock[2][j];
    for (int i = 0; i < 6; i++)
        for (int j = 0; j < 3; j++) ph[i][j] = dot(f->p[i], h[j]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            s[i][j] = r[i][j] + h[i][0] * ph[0][j] + h[i][1] * ph[1][j] + h[i][2] * ph[2][j];
    invert3(s, inverse);
    double gain[6][3], nis = 0.0;
    for (int i = 0; i < 3; i++) nis += y[i] * dot(inverse[i], y);
    if (!(nis <= f->gate)) return;
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 3; j++)
            gain[i][j] = ph[i][0] * inverse[0][j] + ph[i][1] * inverse[1][j] + ph[i][2] * inverse[2][j];
        f->x[i] += dot(gain[i], y);
    }
    joseph(f, gain, h, r);
}

/* One epoch: predict with an acceleration, gate, update, and write range, state and covariance. */
void one_epoch(Filter *f, const double spots[6], const double push[3], double answer[ANSWER]) {
    predict(f, push);
    update(f, spots);
    answer[0] = sqrt(dot(f->x, f->x));
    memcpy(answer + 1, f->x, sizeof f->x);
    memcpy(answer + 7, f->p, sizeof f->p);
}

void many_epochs(Filter *f, long n, const double *spots, const double *push, double *answers) {
    for (long e = 0; e < n; e++) one_epoch(f, spots + 6 * e, push + 3 * e, answers + ANSWER * e);
}
