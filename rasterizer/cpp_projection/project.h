// Projection of one Gaussian, forward and backward: see project.py for the equations.
#pragma once

#include "job.h"
#include "numbers.h"

// The camera in the numbers of the scene.
template <typename T>
struct View {
  using V = typename Wide<T>::of;
  double r[9], t[3];
  double focal_x, focal_y, centre_x, centre_y, low_x, high_x, low_y, high_y;
  Vec<doubles> eye;  // minus the camera's position
  Vec<V> right, down, ahead;
  T fx, fy, left, top, blur;
  bool orthographic;

  explicit View(const Job<T>& job)
      : focal_x(job.focal_x), focal_y(job.focal_y), centre_x(job.centre_x), centre_y(job.centre_y),
        low_x(job.slopes[0]), high_x(job.slopes[1]), low_y(job.slopes[2]), high_y(job.slopes[3]),
        fx(T(job.focal_x)), fy(T(job.focal_y)), left(T(job.left)), top(T(job.top)),
        blur(T(job.blur)), orthographic(job.orthographic) {
    for (int i = 0; i < 3; i++) {
      for (int j = 0; j < 3; j++) r[3 * i + j] = job.pose[4 * i + j];
      t[i] = job.pose[4 * i + 3];
    }
    const V o = V{};
    right = {o + T(r[0]), o + T(r[1]), o + T(r[2])};
    down = {o + T(r[3]), o + T(r[4]), o + T(r[5])};
    ahead = {o + T(r[6]), o + T(r[7]), o + T(r[8])};
    const auto back = [&](int j) { return r[j] * t[0] + r[j + 3] * t[1] + r[j + 6] * t[2]; };
    eye = {doubles{} + back(0), doubles{} + back(1), doubles{} + back(2)};
  }

  INLINE Vec<doubles> in_camera(Vec<V> mean) const {
    const doubles a = widen(mean.x), b = widen(mean.y), c = widen(mean.z);
    return {r[0] * a + r[1] * b + r[2] * c + t[0], r[3] * a + r[4] * b + r[5] * c + t[1],
            r[6] * a + r[7] * b + r[8] * c + t[2]};
  }
  INLINE Vec<doubles> in_world(Vec<doubles> g) const {  // a direction
    return {r[0] * g.x + r[3] * g.y + r[6] * g.z, r[1] * g.x + r[4] * g.y + r[7] * g.z,
            r[2] * g.x + r[5] * g.y + r[8] * g.z};
  }
};

// The projection to first order about a centre.
template <typename V>
struct Linearised {
  doubles z, per_z;  // depth
  doubles slope_x, slope_y;
  V scale_x, scale_y;  // pixels per world unit
  Vec<V> slide_x, slide_y;
  Vec<V> to_x, to_y;  // how far a step in the world moves x, and y, on the picture
};

template <typename T, typename V = typename Wide<T>::of>
INLINE Linearised<V> linearise(const View<T>& v, Vec<V> mean) {
  const Vec<doubles> at = v.in_camera(mean);
  Linearised<V> l;
  l.z = at.z;
  if (v.orthographic) {
    l.per_z = doubles{} + 1, l.slope_x = at.x, l.slope_y = at.y;
    l.slide_x = v.right, l.slide_y = v.down;
  } else {
    l.per_z = 1 / at.z, l.slope_x = at.x / at.z, l.slope_y = at.y / at.z;
    V jx, jy;
    narrow(held(l.slope_x, doubles{} + v.low_x, doubles{} + v.high_x), jx);
    narrow(held(l.slope_y, doubles{} + v.low_y, doubles{} + v.high_y), jy);
    l.slide_x = v.right - jx * v.ahead, l.slide_y = v.down - jy * v.ahead;
  }
  V per_z;
  narrow(l.per_z, per_z);
  l.scale_x = v.fx * per_z, l.scale_y = v.fy * per_z;
  l.to_x = l.scale_x * l.slide_x, l.to_y = l.scale_y * l.slide_y;
  return l;
}

// A rotation's columns, from a quaternion of any norm; zero is the identity.
template <typename V>
struct Rotation {
  V w, x, y, z;  // of unit norm, or zero
  V factor;      // by which the gradient of the unit quaternion is that of the given one; 0: none
  Vec<V> c0, c1, c2;
};

template <typename T, typename V = typename Wide<T>::of>
INLINE Rotation<V> rotation(V w, V x, V y, V z) {
  constexpr T tiny = std::numeric_limits<T>::min() / std::numeric_limits<T>::epsilon();
  const V one = V{} + 1;
  const V largest = most(most(magnitude(w), magnitude(x)), most(magnitude(y), magnitude(z)));
  // by the largest first: neither 1e-30 nor 1e30 has a square in float32
  const V by = largest == 0 ? one : largest;
  w = w / by, x = x / by, y = y / by, z = z / by;
  const V squared = w * w + x * x + y * y + z * z;
  const V norm = inverse_root(largest == 0 ? one : squared);
  Rotation<V> q;
  q.factor = largest < tiny ? V{} : norm / by;
  q.w = w = w * norm, q.x = x = x * norm, q.y = y = y * norm, q.z = z = z * norm;
  q.c0 = {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)};
  q.c1 = {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)};
  q.c2 = {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)};
  return q;
}

// A 2D Gaussian and what leads to it.
template <typename V>
struct Ellipse {
  Vec<V> m1, m2;      // rows of J R_camera R S
  Vec<V> spread;      // m1 over the root of xx
  Vec<V> area;        // spread x m2
  V root;             // one over the root of xx
  V s2;               // |m2|^2
  V xx, xy, yy;       // the blurred covariance
  V sharp, conditional;  // the determinants, unblurred and blurred, over xx
  V w1, w2;           // the whitening: root, w1, w2
};

template <typename T, typename V = typename Wide<T>::of>
INLINE Ellipse<V> ellipse(
    T blur, const Linearised<V>& l, const Rotation<V>& q, Vec<V> scales) {
  Ellipse<V> e;
  e.m1 = scaled(scales, {dot(l.to_x, q.c0), dot(l.to_x, q.c1), dot(l.to_x, q.c2)});
  e.m2 = scaled(scales, {dot(l.to_y, q.c0), dot(l.to_y, q.c1), dot(l.to_y, q.c2)});
  e.xx = dot(e.m1, e.m1) + blur;
  e.xy = dot(e.m1, e.m2);
  e.s2 = dot(e.m2, e.m2);
  e.yy = e.s2 + blur;
  e.root = inverse_root(e.xx);
  e.spread = e.root * e.m1;
  e.area = cross(e.spread, e.m2);
  e.sharp = dot(e.area, e.area);
  e.conditional = e.sharp + blur * (1 + e.s2 / e.xx);
  e.w2 = inverse_root(e.conditional);
  e.w1 = -e.xy / e.xx * e.w2;
  return e;
}

// Half the logarithm of the determinants' ratio; the least number is far below any floor.
template <typename T, typename V = typename Wide<T>::of>
INLINE V log_compensation(const Ellipse<V>& e) {
  const V sharp = most(e.sharp, V{} + std::numeric_limits<T>::min());
  return T(0.5) * (logarithm(sharp) - logarithm(e.conditional));
}

template <typename V>
INLINE V log_sigmoid(V x) {
  return least(x, V{}) - log_one_plus(exponential(-magnitude(x)));
}

// Gradients of one Gaussian's geometry, from those of x, y, w0, w1, w2, the compensation (0: there
// is none) and the depth. `linear`: by the scales, otherwise by their logarithms.
template <typename V>
struct GeometryGradient {
  Vec<V> scales;      // or of their logarithms
  V w, x, y, z;       // of the quaternion
  Vec<doubles> mean;  // in the camera's axes
};

template <typename T, typename V = typename Wide<T>::of>
INLINE GeometryGradient<V> geometry_gradient(
    const View<T>& v, const Linearised<V>& l, const Rotation<V>& q, Vec<V> scales,
    const Ellipse<V>& e, V gx, V gy, V gw0, V gw1, V gw2, V compensation, V gdepth,
    bool linear) {
  GeometryGradient<V> out;
  const V none = V{};
  const V shear = e.xy / e.xx;
  const V by_w2 = gw2 - gw1 * shear;
  const V conditional =
      T(-0.5) * by_w2 * (e.w2 / e.conditional) - T(0.5) * compensation / e.conditional;
  const V smallest = none + std::numeric_limits<T>::min();
  const V sharp = conditional +
      (e.sharp >= smallest ? T(0.5) * compensation / most(e.sharp, smallest) : none);
  const V by_xy = -gw1 * e.w2 / e.xx;
  V by_xx = T(-0.5) * gw0 * (e.root / e.xx) + gw1 * e.w2 * shear / e.xx -
            conditional * v.blur * (e.s2 / e.xx) / e.xx;
  const V by_s2 = conditional * v.blur / e.xx;
  const Vec<V> area = (2 * sharp) * e.area;
  const Vec<V> spread = cross(e.m2, area);
  by_xx += T(-0.5) * dot(spread, e.m1) * (e.root / e.xx);
  const Vec<V> m1 = e.root * spread + (2 * by_xx) * e.m1 + by_xy * e.m2;
  const Vec<V> m2 = cross(area, e.spread) + (2 * by_s2) * e.m2 + by_xy * e.m1;
  out.scales = linear ? scaled(m1, {dot(l.to_x, q.c0), dot(l.to_x, q.c1), dot(l.to_x, q.c2)}) +
                            scaled(m2, {dot(l.to_y, q.c0), dot(l.to_y, q.c1), dot(l.to_y, q.c2)})
                      : scaled(m1, e.m1) + scaled(m2, e.m2);
  const Vec<V> d1 = scaled(m1, scales), d2 = scaled(m2, scales);
  const Vec<V> to_x = d1.x * q.c0 + d1.y * q.c1 + d1.z * q.c2;
  const Vec<V> to_y = d2.x * q.c0 + d2.y * q.c1 + d2.z * q.c2;
  const Vec<V> c0 = d1.x * l.to_x + d2.x * l.to_y, c1 = d1.y * l.to_x + d2.y * l.to_y,
               c2 = d1.z * l.to_x + d2.z * l.to_y;
  const V w = 2 * (q.z * (c0.y - c1.x) + q.y * (c2.x - c0.z) + q.x * (c1.z - c2.y));
  const V x = 2 * (q.y * (c1.x + c0.y) + q.z * (c2.x + c0.z) + q.w * (c1.z - c2.y) -
                   2 * q.x * (c1.y + c2.z));
  const V y = 2 * (q.x * (c1.x + c0.y) + q.z * (c2.y + c1.z) + q.w * (c2.x - c0.z) -
                   2 * q.y * (c0.x + c2.z));
  const V z = 2 * (q.x * (c2.x + c0.z) + q.y * (c2.y + c1.z) + q.w * (c0.y - c1.x) -
                   2 * q.z * (c0.x + c1.y));
  const V along = w * q.w + x * q.x + y * q.y + z * q.z;
  out.w = q.factor == 0 ? none : (w - along * q.w) * q.factor;
  out.x = q.factor == 0 ? none : (x - along * q.x) * q.factor;
  out.y = q.factor == 0 ? none : (y - along * q.y) * q.factor;
  out.z = q.factor == 0 ? none : (z - along * q.z) * q.factor;
  doubles slope_x = v.focal_x * widen(gx), slope_y = v.focal_y * widen(gy);
  if (v.orthographic) {
    out.mean = {slope_x, slope_y, widen(gdepth)};
    return out;
  }
  const V by_per_z = v.fx * dot(l.slide_x, to_x) + v.fy * dot(l.slide_y, to_y);
  const doubles jx = widen(l.scale_x * dot(v.ahead, to_x));
  const doubles jy = widen(l.scale_y * dot(v.ahead, to_y));
  slope_x -= (l.slope_x >= v.low_x) & (l.slope_x <= v.high_x) ? jx : doubles{};
  slope_y -= (l.slope_y >= v.low_y) & (l.slope_y <= v.high_y) ? jy : doubles{};
  out.mean = {slope_x * l.per_z, slope_y * l.per_z,
              widen(gdepth) - (slope_x * l.slope_x + slope_y * l.slope_y) * l.per_z -
                  widen(by_per_z) * l.per_z * l.per_z};
  return out;
}
