// Real spherical harmonics of degree 0 to 4 and their derivatives: see harmonics.py.
#pragma once

#include "numbers.h"

constexpr int MOST_BANDS = 25;  // (4 + 1)^2 coefficients a channel

constexpr double C0 = 0.28209479177387814, C1 = 0.4886025119029199;
constexpr double C2[] = {1.0925484305920792, 0.31539156525252005, 0.5462742152960396};
constexpr double C3[] = {0.5900435899266435, 2.890611442640554, 0.4570457994644658,
                         0.3731763325901154, 1.445305721320277};
constexpr double C4[] = {2.5033429417967046, 1.7701307697799304, 0.9461746957575601,
                         0.6690465435572892, 0.10578554691520431, 0.47308734787878004,
                         0.6258357354491761};

// The first COUNT harmonics at unit directions.
template <typename T, int COUNT>
INLINE void basis(Vec<typename Wide<T>::of> d, typename Wide<T>::of* y) {
  using V = typename Wide<T>::of;
  const V X = d.x, Y = d.y, Z = d.z, xx = X * X, yy = Y * Y, zz = Z * Z;
  y[0] = V{} + T(C0);
  if (COUNT <= 1) return;
  y[1] = -T(C1) * Y;
  y[2] = T(C1) * Z;
  y[3] = -T(C1) * X;
  if (COUNT <= 4) return;
  y[4] = T(C2[0]) * X * Y;
  y[5] = -T(C2[0]) * Y * Z;
  y[6] = T(C2[1]) * (2 * zz - xx - yy);
  y[7] = -T(C2[0]) * X * Z;
  y[8] = T(C2[2]) * (xx - yy);
  if (COUNT <= 9) return;
  y[9] = -T(C3[0]) * Y * (3 * xx - yy);
  y[10] = T(C3[1]) * X * Y * Z;
  y[11] = -T(C3[2]) * Y * (4 * zz - xx - yy);
  y[12] = T(C3[3]) * Z * (2 * zz - 3 * xx - 3 * yy);
  y[13] = -T(C3[2]) * X * (4 * zz - xx - yy);
  y[14] = T(C3[4]) * Z * (xx - yy);
  y[15] = -T(C3[0]) * X * (xx - 3 * yy);
  if (COUNT <= 16) return;
  y[16] = T(C4[0]) * X * Y * (xx - yy);
  y[17] = -T(C4[1]) * Y * Z * (3 * xx - yy);
  y[18] = T(C4[2]) * X * Y * (7 * zz - 1);
  y[19] = -T(C4[3]) * Y * Z * (7 * zz - 3);
  y[20] = T(C4[4]) * (zz * (35 * zz - 30) + 3);
  y[21] = -T(C4[3]) * X * Z * (7 * zz - 3);
  y[22] = T(C4[5]) * (xx - yy) * (7 * zz - 1);
  y[23] = -T(C4[1]) * X * Z * (xx - 3 * yy);
  y[24] = T(C4[6]) * (xx * (xx - 3 * yy) - yy * (3 * xx - yy));
}

// Gradient by the direction of sum_k g_k y_k.
template <typename T, int COUNT>
INLINE Vec<typename Wide<T>::of> basis_gradient(
    Vec<typename Wide<T>::of> d, const typename Wide<T>::of* g) {
  using V = typename Wide<T>::of;
  const V o = V{}, one = o + 1, X = d.x, Y = d.y, Z = d.z, xx = X * X, yy = Y * Y, zz = Z * Z;
  Vec<V> s = {o, o, o};
  if (COUNT <= 1) return s;
  const auto add = [&](int k, double c, V x, V y, V z) __attribute__((always_inline)) {
    const V f = T(c) * g[k];
    s.x += f * x, s.y += f * y, s.z += f * z;
  };
  add(1, -C1, o, one, o);
  add(2, C1, o, o, one);
  add(3, -C1, one, o, o);
  if (COUNT <= 4) return s;
  add(4, C2[0], Y, X, o);
  add(5, -C2[0], o, Z, Y);
  add(6, C2[1], -2 * X, -2 * Y, 4 * Z);
  add(7, -C2[0], Z, o, X);
  add(8, C2[2], 2 * X, -2 * Y, o);
  if (COUNT <= 9) return s;
  add(9, -C3[0], 6 * X * Y, 3 * (xx - yy), o);
  add(10, C3[1], Y * Z, X * Z, X * Y);
  add(11, -C3[2], -2 * X * Y, 4 * zz - xx - 3 * yy, 8 * Y * Z);
  add(12, C3[3], -6 * X * Z, -6 * Y * Z, 6 * zz - 3 * xx - 3 * yy);
  add(13, -C3[2], 4 * zz - 3 * xx - yy, -2 * X * Y, 8 * X * Z);
  add(14, C3[4], 2 * X * Z, -2 * Y * Z, xx - yy);
  add(15, -C3[0], 3 * (xx - yy), -6 * X * Y, o);
  if (COUNT <= 16) return s;
  add(16, C4[0], Y * (3 * xx - yy), X * (xx - 3 * yy), o);
  add(17, -C4[1], 6 * X * Y * Z, 3 * Z * (xx - yy), Y * (3 * xx - yy));
  add(18, C4[2], Y * (7 * zz - 1), X * (7 * zz - 1), 14 * X * Y * Z);
  add(19, -C4[3], o, Z * (7 * zz - 3), Y * (21 * zz - 3));
  add(20, C4[4], o, o, Z * (140 * zz - 60));
  add(21, -C4[3], Z * (7 * zz - 3), o, X * (21 * zz - 3));
  add(22, C4[5], 2 * X * (7 * zz - 1), -2 * Y * (7 * zz - 1), 14 * Z * (xx - yy));
  add(23, -C4[1], 3 * Z * (xx - yy), -6 * X * Y * Z, X * (xx - 3 * yy));
  add(24, C4[6], 4 * X * (xx - 3 * yy), 4 * Y * (yy - 3 * xx), o);
  return s;
}
