// Numbers of LANES Gaussians side by side, and the functions of them that are needed. GCC's and
// Clang's vectors are as wide as this on every processor: they are cut where its own are narrower.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

constexpr int LANES = 8;

#define INLINE inline __attribute__((always_inline))

typedef float floats __attribute__((vector_size(4 * LANES)));
typedef double doubles __attribute__((vector_size(8 * LANES)));
typedef int32_t ints __attribute__((vector_size(4 * LANES)));
typedef int64_t longs __attribute__((vector_size(8 * LANES)));

template <typename T>
struct Wide;
template <>
struct Wide<float> {
  using of = floats;
  using mask = ints;  // -1 where it holds, otherwise 0
};
template <>
struct Wide<double> {
  using of = doubles;
  using mask = longs;
};

template <typename To, typename From>
INLINE To as(const From& from) {  // the same bits
  static_assert(sizeof(To) == sizeof(From), "");
  To to;
  std::memcpy(&to, &from, sizeof to);
  return to;
}
template <typename V, typename T>
INLINE V load(const T* from) {
  V v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
template <typename V, typename T>
INLINE void store(const V& v, T* to) { std::memcpy(to, &v, sizeof v); }

INLINE doubles widen(floats v) { return __builtin_convertvector(v, doubles); }
INLINE doubles widen(doubles v) { return v; }
INLINE void narrow(doubles v, floats& to) { to = __builtin_convertvector(v, floats); }
INLINE void narrow(doubles v, doubles& to) { to = v; }
INLINE void narrow(longs v, ints& to) { to = __builtin_convertvector(v, ints); }
INLINE void narrow(longs v, longs& to) { to = v; }

// As std::min and std::max: the first where one is NaN.
template <typename V>
INLINE V least(V a, V b) { return b < a ? b : a; }
template <typename V>
INLINE V most(V a, V b) { return a < b ? b : a; }
template <typename V>
INLINE V held(V x, V low, V high) { return least(most(x, low), high); }
template <typename V>
INLINE V magnitude(V x) { return x < 0 ? -x : x; }

#define EACH(name, function)                                        \
  template <typename V>                                             \
  INLINE V name(V x) {                                              \
    decltype(x[0] + x[0]) values[LANES];                            \
    store(x, values);                                               \
    _Pragma("omp simd") for (int i = 0; i < LANES; i++)             \
        values[i] = function(values[i]);                            \
    return load<V>(values);                                         \
  }
EACH(root, std::sqrt)
EACH(rounded_up, std::ceil)
EACH(each_exp, std::exp)
EACH(each_log, std::log)
EACH(each_log1p, std::log1p)
#undef EACH

template <typename V>
INLINE V inverse_root(V x) { return 1 / root(x); }

// exp of any number, to an ulp or two: 2^n times the Taylor series of what remains,
// |r| <= ln2 / 2.
INLINE floats exponential(floats x) {
  const floats low = floats{} - 104.0f, high = floats{} + 89.0f;  // beyond, 0 and infinity
  x = held(x, low, high);
  const float round = 12582912.0f;  // 1.5 * 2^23: what is added to it is rounded to a whole number
  const floats n = (x * 1.44269504f + round) - round;
  const floats r = (x - n * 0.693359375f) + n * 2.12194440e-4f;  // the first product is exact
  floats s = floats{} + 1.0f / 5040;
  s = s * r + 1.0f / 720, s = s * r + 1.0f / 120, s = s * r + 1.0f / 24, s = s * r + 1.0f / 6;
  s = s * r + 0.5f, s = s * r + 1.0f, s = s * r + 1.0f;
  const ints whole = __builtin_convertvector(n, ints), half = whole >> 1;
  return s * as<floats>((half + 127) << 23) * as<floats>((whole - half + 127) << 23);
}
INLINE doubles exponential(doubles x) { return each_exp(x); }

// log(1 + u) for 0 <= u <= 1: 2 artanh(u / (2 + u)), by its series
INLINE floats log_one_plus(floats u) {
  const floats t = u / (2 + u), q = t * t;
  floats s = floats{} + 1.0f / 15;
  s = s * q + 1.0f / 13, s = s * q + 1.0f / 11, s = s * q + 1.0f / 9, s = s * q + 1.0f / 7;
  s = s * q + 1.0f / 5, s = s * q + 1.0f / 3;
  return 2 * (t + t * q * s);
}
INLINE doubles log_one_plus(doubles u) { return each_log1p(u); }

// log of a normal number above 0: of m in [1/sqrt 2, sqrt 2), plus n log 2
INLINE floats logarithm(floats x) {
  const ints bits = as<ints>(x), n = (bits - 0x3f3504f3) >> 23;  // 0x3f3504f3 is sqrt(1/2)
  const floats f = as<floats>(bits - (n << 23)) - 1, t = f / (2 + f), q = t * t;
  const floats whole = __builtin_convertvector(n, floats);
  floats s = floats{} + 1.0f / 9;
  s = s * q + 1.0f / 7, s = s * q + 1.0f / 5, s = s * q + 1.0f / 3;
  return whole * 0.693359375f + (2 * (t + t * q * s) - whole * 2.12194440e-4f);
}
INLINE doubles logarithm(doubles x) { return each_log(x); }

template <typename V>
struct Vec {
  V x, y, z;
};

#ifdef __clang__
#define PICK(M, a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define PICK(M, a, b, ...) __builtin_shuffle(a, b, M{__VA_ARGS__})
#endif

// LANES rows of three numbers, which lie one after another. Numbers that are stored one by one and
// loaded as a vector would wait for the stores.
template <typename T>
INLINE Vec<typename Wide<T>::of> load_rows(const T* from) {
  static_assert(LANES == 8, "places of the numbers");
  using V = typename Wide<T>::of;
  using M = typename Wide<T>::mask;
  const V a = load<V>(from), b = load<V>(from + LANES), c = load<V>(from + 2 * LANES);
  const V x = PICK(M, a, b, 0, 3, 6, 9, 12, 15, 0, 0), y = PICK(M, a, b, 1, 4, 7, 10, 13, 0, 0, 0);
  const V z = PICK(M, a, b, 2, 5, 8, 11, 14, 0, 0, 0);
  return {PICK(M, x, c, 0, 1, 2, 3, 4, 5, 10, 13), PICK(M, y, c, 0, 1, 2, 3, 4, 8, 11, 14),
          PICK(M, z, c, 0, 1, 2, 3, 4, 9, 12, 15)};
}
#undef PICK
template <typename V>
INLINE Vec<V> operator+(Vec<V> a, Vec<V> b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
template <typename V>
INLINE Vec<V> operator-(Vec<V> a, Vec<V> b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
template <typename V>
INLINE Vec<V> operator*(V s, Vec<V> a) { return {s * a.x, s * a.y, s * a.z}; }
template <typename V>
INLINE Vec<V> scaled(Vec<V> a, Vec<V> b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
template <typename V>
INLINE V dot(Vec<V> a, Vec<V> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <typename V>
INLINE Vec<V> cross(Vec<V> a, Vec<V> b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
