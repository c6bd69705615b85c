/* The estimator loops in C, the yardstick of benchmarks/estimators.py.
 *
 * Same equations, same default schemes, same interface as the compiled loops: parameters in the
 * order of `Params`, t [ns], K [N], y [rad/s], one segment of n samples, F [N]. Without the euler
 * branch, which the defaults do not take. neso_euler is that branch of neso.
 */
#include <math.h>
#include <stdint.h>

typedef const double *restrict in;
typedef double *restrict out;

typedef struct { double e, d; } observer;

static inline observer advance(observer s, double b1, double b2, double h, double kappa,
                               double kappa_rate, double y_rate) {
    double e_line = -kappa_rate / b2, d_line = y_rate + kappa + b1 * e_line;
    double sigma = 0.5 * b1, D = sigma * sigma - b2, C, S;
    if (D >= 0.0) {
        double r = sqrt(D), slow = exp(-b2 * h / (sigma + r)), gap = -expm1(-2.0 * r * h);
        C = slow * (1.0 - 0.5 * gap);
        S = slow * (r > 0.0 ? gap / (2.0 * r) : h);
    } else {
        double r = sqrt(-D), decay = exp(-sigma * h);
        C = decay * cos(r * h);
        S = decay * sin(r * h) / r;
    }
    double e = s.e - e_line, d = s.d - d_line;
    return (observer){C * e + S * (d - sigma * e) + e_line,
                      C * d + S * (sigma * d - b2 * e) + d_line + kappa_rate * h};
}

static void linear(double b1, double b2, in w, const int64_t *t, in K, in y, long n, out F) {
    observer s = {0.0, 0.0};
    F[0] = 0.0;
    for (long i = 1; i < n; i++) {
        double h = (double)(t[i] - t[i - 1]) * 1e-9;
        s = advance(s, b1, b2, h, w[0] * w[1] * K[i - 1], w[0] * w[1] * (K[i] - K[i - 1]) / h,
                    (y[i] - y[i - 1]) / h);
        F[i] = s.d / w[0];
    }
}

void leso(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    linear(p[0], p[1], w, t, K, y, n, F);
}

void gradient(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    linear(p[0], p[1], w, t, K, y, n, F);
}

static inline double fal_gain(double x, double alpha, double delta) {
    return pow(fmax(fabs(x), delta), alpha - 1.0);
}

void neso(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    observer s = {0.0, 0.0};
    F[0] = 0.0;
    for (long i = 1; i < n; i++) {
        double h = (double)(t[i] - t[i - 1]) * 1e-9;
        double kappa = w[0] * w[1] * K[i - 1], kappa_rate = w[0] * w[1] * (K[i] - K[i - 1]) / h;
        double y_rate = (y[i] - y[i - 1]) / h;
        double b1 = p[0] * fal_gain(0.0, p[2], p[4]), b2 = p[1] * fal_gain(0.0, p[3], p[4]);
        long m = (long)fmin(ceil(h * (b1 + sqrt(b2))), 4096.0);
        double tau = h / (double)m;
        for (long j = 0; j < m; j++) {
            double k = kappa + (double)j * tau * kappa_rate;
            b1 = p[0] * fal_gain(s.e, p[2], p[4]);
            b2 = p[1] * fal_gain(s.e, p[3], p[4]);
            double e = advance(s, b1, b2, 0.5 * tau, k, kappa_rate, y_rate).e;
            b1 = p[0] * fal_gain(e, p[2], p[4]);
            b2 = p[1] * fal_gain(e, p[3], p[4]);
            s = advance(s, b1, b2, tau, k, kappa_rate, y_rate);
        }
        F[i] = s.d / w[0];
    }
}

void neso_euler(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    observer s = {0.0, 0.0};
    F[0] = 0.0;
    for (long i = 1; i < n; i++) {
        double h = (double)(t[i] - t[i - 1]) * 1e-9;
        double b1 = p[0] * fal_gain(s.e, p[2], p[4]), b2 = p[1] * fal_gain(s.e, p[3], p[4]);
        s = (observer){s.e + y[i - 1] - y[i] + h * (s.d - w[0] * w[1] * K[i - 1] - b1 * s.e),
                       s.d - h * b2 * s.e};
        F[i] = s.d / w[0];
    }
}

static inline double fhan(double x1, double x2, double r, double h) {
    double d = r * h * h, a0 = h * x2, y = x1 + a0, a;
    if (fabs(y) <= d)
        a = a0 + y;
    else
        a = a0 + copysign(0.5 * (sqrt(d * (d + 8.0 * fabs(y))) - d), y);
    return fabs(a) <= d ? -r * a / d : -copysign(r, a);
}

void td(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    double x1 = p[2] > 0.0 ? 0.0 : y[0], x2 = 0.0;
    F[0] = w[1] * K[0];
    for (long i = 1; i < n; i++) {
        double h = (double)(t[i] - t[i - 1]) * 1e-9, h0 = p[1] > 0.0 ? p[1] : h;
        long m = (long)fmin(ceil(4.0 * h / h0), 4096.0);
        double tau = h / (double)m, dv = (y[i] - y[i - 1]) / (double)m;
        h0 = fmax(h0, 4.0 * tau);
        for (long j = 0; j < m; j++) {
            double v = y[i - 1] + (double)j * dv;
            double middle = x2 + 0.5 * tau * fhan(x1 - v, x2, p[0], h0);
            double rate = fhan(x1 + 0.5 * tau * x2 - v - 0.5 * dv, middle, p[0], h0);
            x1 += tau * middle;
            x2 += tau * rate;
        }
        F[i] = w[1] * K[i] + x2 / w[0];
    }
}

void kalman(in p, in w, const int64_t *t, in K, in y, long n, out F) {
    double omega = y[0], P = p[3], weight = 0.0;
    F[0] = 0.0;
    for (long i = 1; i < n; i++) {
        double h = (double)(t[i] - t[i - 1]) * 1e-9, held = 0.5 * (K[i - 1] + K[i]);
        double predicted = omega + h * w[0] * (F[i - 1] - w[1] * held);
        P += p[1] * h;
        double G = P / (P + p[2] * 1e-3 / h), updated = predicted + G * (y[i] - predicted);
        double b = pow(p[0], h / 1e-3);
        weight = b * weight + (1.0 - b);
        double d = (1.0 - b) / weight, eps1 = updated - omega + h * w[0] * w[1] * held;
        F[i] = (1.0 - d) * F[i - 1] + d * eps1 / (h * w[0]);
        omega = updated;
        P *= 1.0 - G;
    }
}
