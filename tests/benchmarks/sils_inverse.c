/* The inverse of SILS written by hand for vectors: what tests/benchmarks compares the compiled kernels with.
 *
 * Arrays are one a number (structure of arrays), as many samples as a multiple of W. Constants are folded and the
 * rows of eq. (2) solved for both carriages by hand:  q_even = along + s h,  q_odd = along + s (l2 - l1) / L h.
 *
 *     joints_of_coordinates   X Y Z psi theta phi -> q1 .. q6, with sine and cosine of its own
 *     joints_of_pose          16 numbers -> q1 .. q6 and how far they are from the pose of their own angles
 *     joints_of_rotation      16 numbers -> q1 .. q6 straight from the rotation: what the equations do not say
 *     roof                    as many bytes in and out as joints_of_coordinates, copied
 */
#include <immintrin.h>
#include <stdint.h>

#ifdef __AVX512F__
#define W 8
#define ROOT(x) ((v)_mm512_sqrt_pd((__m512d)(x)))
#else
#define W 4
#define ROOT(x) ((v)_mm256_sqrt_pd((__m256d)(x)))
#endif

typedef double v __attribute__((vector_size(8 * W), aligned(8), may_alias));
typedef int64_t vi __attribute__((vector_size(8 * W)));

static const double L0 = 0.050, L1 = 0.182, L2 = 0.392, LP = 0.135, LV = 0.657, LH = 0.612;
#define BAR (L1 + L2)
#define SHARE ((L2 - L1) / BAR)
#define A6 (LP * 0.28867513459481288)
#define A3 (LP * 0.57735026918962576)
#define A2 (LP * 0.5)

static inline void sines(v x, v *s, v *c) {
    const double turn = 0x1.8p52;
    v shifted = x * 0.63661977236758134 + turn;
    vi quadrant = (vi)shifted;
    v n = shifted - turn;
    v r = (x - n * 1.5707963267948966) - n * 6.123233995736766e-17;
    v z = r * r;
    v sp = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08;
    sp = sp * z + 2.75573137070700676789e-06;
    sp = sp * z - 1.98412698298579493134e-04;
    sp = sp * z + 8.33333333332248946124e-03;
    sp = sp * z - 1.66666666666666324348e-01;
    sp = sp * (z * r) + r;
    v cp = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09;
    cp = cp * z - 2.75573143513906633035e-07;
    cp = cp * z + 2.48015872894767294178e-05;
    cp = cp * z - 1.38888888888741095749e-03;
    cp = cp * z + 4.16666666666666019037e-02;
    cp = cp * (z * z) + (1.0 - 0.5 * z);
    vi odd = -(quadrant & 1);
    vi a = ((vi)sp & ~odd) | ((vi)cp & odd), b = ((vi)cp & ~odd) | ((vi)sp & odd);
    *s = (v)(a ^ (quadrant << 62 & INT64_MIN));
    *c = (v)(b ^ ((quadrant + 1) << 62 & INT64_MIN));
}

static inline void limb(v x, v across, v along, double sign, double *odd, double *even) {
    v rho = ROOT(x * x + across * across);
    v h = ROOT(BAR * BAR - (rho - L0) * (rho - L0));
    *(v *)odd = along + sign * SHARE * h;
    *(v *)even = along + sign * h;
}

#define LIMBS(X, Y, Z, xu, yu, zu, xv, yv, zv)                                                    \
    limb(X + A6 * (xu) - A2 * (xv), Y + A6 * (yu) - A2 * (yv), Z + A6 * (zu) - A2 * (zv), 1.0,    \
         q[0] + i, q[1] + i);                                                                     \
    limb(X - A3 * (xu), LV - (Z - A3 * (zu)), Y - A3 * (yu), -1.0, q[2] + i, q[3] + i);           \
    limb(X + A6 * (xu) + A2 * (xv), LH - (Y + A6 * (yu) + A2 * (yv)), Z + A6 * (zu) + A2 * (zv),  \
         1.0, q[4] + i, q[5] + i)

#define IN(k) (*(const v *)(in[k] + i))

void joints_of_coordinates(int64_t n, const double *const *restrict in, double *const *restrict q) {
    for (int64_t i = 0; i < n; i += W) {
        v X = IN(0), Y = IN(1), Z = IN(2), sa, ca, sb, cb, sc, cc;
        sines(IN(3), &sa, &ca);
        sines(IN(4), &sb, &cb);
        sines(IN(5), &sc, &cc);
        LIMBS(X, Y, Z, ca * cb, sa * cb, -sb, ca * sb * sc - sa * cc, sa * sb * sc + ca * cc, cb * sc);
    }
}

void joints_of_pose(int64_t n, const double *const *restrict in, double *const *restrict q) {
    const v none = {0}, one = none + 1.0;
    for (int64_t i = 0; i < n; i += W) {
        v R00 = IN(0), R10 = IN(4), R20 = IN(8), R21 = IN(9), R22 = IN(10);
        v aa = R00 * R00 + R10 * R10, bb = aa + R20 * R20, dd = R21 * R21 + R22 * R22;
        v a = ROOT(aa), b = 1.0 / ROOT(bb), d = 1.0 / ROOT(dd), ia = 1.0 / a;
        vi some = (vi)(a > none);
        v ca = (v)(((vi)(R00 * ia) & some) | ((vi)one & ~some)), sa = (v)((vi)(R10 * ia) & some);
        v cb = a * b, sb = -R20 * b, cc = R22 * d, sc = R21 * d;
        v xu = ca * cb, yu = sa * cb, xv = ca * sb * sc - sa * cc, yv = sa * sb * sc + ca * cc, zv = cb * sc;
        LIMBS(IN(3), IN(7), IN(11), xu, yu, -sb, xv, yv, zv);
        v m = (xu - R00) * (xu - R00) + (yu - R10) * (yu - R10) + (sb + R20) * (sb + R20);
        v x = xv - IN(1), y = yv - IN(5), z = zv - R21;
        m += x * x + y * y + z * z;
        x = ca * sb * cc + sa * sc - IN(2), y = sa * sb * cc - ca * sc - IN(6), z = cb * cc - R22;
        m += x * x + y * y + z * z;
        m += IN(12) * IN(12) + IN(13) * IN(13) + IN(14) * IN(14) + (1.0 - IN(15)) * (1.0 - IN(15));
        *(v *)(q[6] + i) = ROOT(m);
    }
}

void joints_of_rotation(int64_t n, const double *const *restrict in, double *const *restrict q) {
    for (int64_t i = 0; i < n; i += W) {
        LIMBS(IN(3), IN(7), IN(11), IN(0), IN(4), IN(8), IN(1), IN(5), IN(9));
    }
}

void roof(int64_t n, const double *const *restrict in, double *const *restrict q) {
    for (int64_t i = 0; i < n; i += W)
        for (int k = 0; k < 6; k++)
            *(v *)(q[k] + i) = IN(k);
}
