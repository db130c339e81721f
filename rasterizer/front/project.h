// Projection of one Gaussian, forward and backward: see project.py for the equations.
#pragma once

#include "job.h"
#include "numbers.h"

// The camera in the numbers of the scene.
template <typename T>
struct View {
  double r[9], t[3];
  double focal_x, focal_y, centre_x, centre_y, low_x, high_x, low_y, high_y;
  Vec<T> right, down, ahead;
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
    right = {T(r[0]), T(r[1]), T(r[2])};
    down = {T(r[3]), T(r[4]), T(r[5])};
    ahead = {T(r[6]), T(r[7]), T(r[8])};
  }
};

// The projection to first order about a centre.
template <typename T>
struct Linearised {
  double x, y, z;  // the centre in the camera's axes
  double slope_x, slope_y;
  T jx, jy, per_z;
  Vec<T> to_x, to_y;  // how far a step in the world moves x, and y, on the picture
};

template <typename T>
inline Linearised<T> linearise(const View<T>& v, Vec<T> mean) {
  const double a = mean.x, b = mean.y, c = mean.z;
  Linearised<T> l;
  l.x = v.r[0] * a + v.r[1] * b + v.r[2] * c + v.t[0];
  l.y = v.r[3] * a + v.r[4] * b + v.r[5] * c + v.t[1];
  l.z = v.r[6] * a + v.r[7] * b + v.r[8] * c + v.t[2];
  const double per_z = v.orthographic ? 1.0 : 1.0 / l.z;
  l.slope_x = v.orthographic ? l.x : l.x / l.z, l.slope_y = v.orthographic ? l.y : l.y / l.z;
  l.per_z = T(per_z);
  l.jx = v.orthographic ? T(0) : T(held(l.slope_x, v.low_x, v.high_x));
  l.jy = v.orthographic ? T(0) : T(held(l.slope_y, v.low_y, v.high_y));
  l.to_x = (v.fx * l.per_z) * (v.right - l.jx * v.ahead);
  l.to_y = (v.fy * l.per_z) * (v.down - l.jy * v.ahead);
  return l;
}

// A rotation's columns, from a quaternion of any norm; zero is the identity.
template <typename T>
struct Rotation {
  T w, x, y, z;  // of unit norm, or zero
  T factor;      // by which the gradient of the unit quaternion is that of the given one; 0: none
  Vec<T> c0, c1, c2;
};

template <typename T>
inline Rotation<T> rotation(T w, T x, T y, T z) {
  const T largest = std::max(std::max(std::abs(w), std::abs(x)), std::max(std::abs(y), std::abs(z)));
  constexpr T tiny = std::numeric_limits<T>::min() / std::numeric_limits<T>::epsilon();
  // by the largest first: neither 1e-30 nor 1e30 has a square in float32
  const T by = largest == T(0) ? T(1) : largest;
  w = w / by, x = x / by, y = y / by, z = z / by;
  const T squared = w * w + x * x + y * y + z * z;
  const T norm = inverse_root(largest == T(0) ? T(1) : squared);
  Rotation<T> q;
  q.factor = largest < tiny ? T(0) : norm / by;
  q.w = w = w * norm, q.x = x = x * norm, q.y = y = y * norm, q.z = z = z * norm;
  q.c0 = {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)};
  q.c1 = {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)};
  q.c2 = {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)};
  return q;
}

// A 2D Gaussian and what leads to it.
template <typename T>
struct Ellipse {
  Vec<T> m1, m2;      // rows of J R_camera R S
  Vec<T> spread;      // m1 over the root of xx
  Vec<T> area;        // spread x m2
  T root;             // one over the root of xx
  T s2;               // |m2|^2
  T xx, xy, yy;       // the blurred covariance
  T sharp, conditional;  // the determinants, unblurred and blurred, over xx
  T w1, w2;           // the whitening: root, w1, w2
};

template <typename T>
inline Ellipse<T> ellipse(
    T blur, const Linearised<T>& l, const Rotation<T>& q, Vec<T> scales) {
  Ellipse<T> e;
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
template <typename T>
inline T log_compensation(const Ellipse<T>& e) {
  const T sharp = std::max(e.sharp, std::numeric_limits<T>::min());
  return T(0.5) * (logarithm(sharp) - logarithm(e.conditional));
}

template <typename T>
inline T log_sigmoid(T x) {
  return std::min(x, T(0)) - log_one_plus(exponential(-std::abs(x)));
}

// Gradients of one Gaussian's geometry, from those of x, y, w0, w1, w2, the compensation (0: there
// is none) and the depth.
template <typename T>
struct GeometryGradient {
  Vec<T> log_scales;
  T w, x, y, z;              // of the quaternion
  double mean_x, mean_y, mean_z;  // in the camera's axes
};

template <typename T>
inline GeometryGradient<T> geometry_gradient(
    const View<T>& v, const Linearised<T>& l, const Rotation<T>& q, Vec<T> scales,
    const Ellipse<T>& e, T gx, T gy, T gw0, T gw1, T gw2, T compensation, T gdepth) {
  GeometryGradient<T> out;
  const T shear = e.xy / e.xx;
  const T by_w2 = gw2 - gw1 * shear;
  const T conditional =
      T(-0.5) * by_w2 * (e.w2 / e.conditional) - T(0.5) * compensation / e.conditional;
  const T least = std::numeric_limits<T>::min();
  const T sharp =
      conditional + (e.sharp >= least ? T(0.5) * compensation / std::max(e.sharp, least) : T(0));
  const T by_xy = -gw1 * e.w2 / e.xx;
  T by_xx = T(-0.5) * gw0 * (e.root / e.xx) + gw1 * e.w2 * shear / e.xx -
            conditional * v.blur * (e.s2 / e.xx) / e.xx;
  const T by_s2 = conditional * v.blur / e.xx;
  const Vec<T> area = (2 * sharp) * e.area;
  const Vec<T> spread = cross(e.m2, area);
  by_xx += T(-0.5) * dot(spread, e.m1) * (e.root / e.xx);
  const Vec<T> m1 = e.root * spread + (2 * by_xx) * e.m1 + by_xy * e.m2;
  const Vec<T> m2 = cross(area, e.spread) + (2 * by_s2) * e.m2 + by_xy * e.m1;
  out.log_scales = scaled(m1, e.m1) + scaled(m2, e.m2);
  const Vec<T> d1 = scaled(m1, scales), d2 = scaled(m2, scales);
  const Vec<T> to_x = d1.x * q.c0 + d1.y * q.c1 + d1.z * q.c2;
  const Vec<T> to_y = d2.x * q.c0 + d2.y * q.c1 + d2.z * q.c2;
  const Vec<T> c0 = d1.x * l.to_x + d2.x * l.to_y, c1 = d1.y * l.to_x + d2.y * l.to_y,
               c2 = d1.z * l.to_x + d2.z * l.to_y;
  const T w = 2 * (q.z * (c0.y - c1.x) + q.y * (c2.x - c0.z) + q.x * (c1.z - c2.y));
  const T x = 2 * (q.y * (c1.x + c0.y) + q.z * (c2.x + c0.z) + q.w * (c1.z - c2.y) -
                   2 * q.x * (c1.y + c2.z));
  const T y = 2 * (q.x * (c1.x + c0.y) + q.z * (c2.y + c1.z) + q.w * (c2.x - c0.z) -
                   2 * q.y * (c0.x + c2.z));
  const T z = 2 * (q.x * (c2.x + c0.z) + q.y * (c2.y + c1.z) + q.w * (c0.y - c1.x) -
                   2 * q.z * (c0.x + c1.y));
  const T along = w * q.w + x * q.x + y * q.y + z * q.z;
  const bool turns = q.factor != T(0);
  out.w = turns ? (w - along * q.w) * q.factor : T(0);
  out.x = turns ? (x - along * q.x) * q.factor : T(0);
  out.y = turns ? (y - along * q.y) * q.factor : T(0);
  out.z = turns ? (z - along * q.z) * q.factor : T(0);
  const double depth = gdepth;
  double slope_x = v.focal_x * gx, slope_y = v.focal_y * gy;
  if (v.orthographic) {
    out.mean_x = slope_x, out.mean_y = slope_y, out.mean_z = depth;
    return out;
  }
  const T by_per_z = v.fx * dot(v.right - l.jx * v.ahead, to_x) +
                     v.fy * dot(v.down - l.jy * v.ahead, to_y);
  const double jx = -(v.fx * l.per_z) * dot(v.ahead, to_x);
  const double jy = -(v.fy * l.per_z) * dot(v.ahead, to_y);
  slope_x += l.slope_x >= v.low_x && l.slope_x <= v.high_x ? jx : 0.0;
  slope_y += l.slope_y >= v.low_y && l.slope_y <= v.high_y ? jy : 0.0;
  const double per_z = 1.0 / l.z;
  out.mean_x = slope_x * per_z, out.mean_y = slope_y * per_z;
  out.mean_z = depth - (slope_x * l.slope_x + slope_y * l.slope_y) * per_z -
               double(by_per_z) * per_z * per_z;
  return out;
}
