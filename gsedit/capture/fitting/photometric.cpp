// (1 - w) L1 + w (1 - SSIM) between pictures and their targets, and its gradient by the pictures, in
// one pass. losses.py says what each means; here SSIM's window is two passes of 11 taps.
//
// Pictures are rows of width * channels numbers. A row of the gradient needs 10 rows above and below
// of the pictures, so rows run through two rings: filtered along x, then SSIM's derivatives.
// Compiled and called by photometric.py.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "threads.h"

namespace {

constexpr int REACH = 5;  // pixels to each side that the window takes in
constexpr int TAPS = 2 * REACH + 1;
constexpr double SIGMA = 1.5, C1 = 0.01 * 0.01, C2 = 0.03 * 0.03, EPSILON = 1e-12;

template <typename T>
struct Job {
  const T* image;   // [pictures, height, width, channels]
  const T* target;  // the same
  int64_t pictures, height, width, channels, threads;
  double weight;    // w
  double* sums;     // [pictures * height, 2]: of |image - target| and of SSIM over each row
  T* gradient;      // as the image, or null
};

template <typename T>
struct Window {
  T taps[TAPS];
  Window() {
    double sum = 0;
    for (int k = -REACH; k <= REACH; k++) sum += std::exp(-0.5 * k * k / (SIGMA * SIGMA));
    for (int k = -REACH; k <= REACH; k++)
      taps[k + REACH] = T(std::exp(-0.5 * k * k / (SIGMA * SIGMA)) / sum);
  }
};

inline int64_t reflected(int64_t i, int64_t size) {
  return i < 0 ? -i : i >= size ? 2 * (size - 1) - i : i;
}

// How much rows i - REACH ... i + REACH weigh in filtered row i; rows outside weigh nothing, and
// those inside again what is reflected onto them. `adjoint`: the other way, how much source row i
// weighs in those filtered rows.
template <typename T>
void weights(const Window<T>& window, int64_t i, int64_t size, bool adjoint, T* out) {
  std::fill(out, out + TAPS, T(0));
  for (int64_t at = std::max<int64_t>(0, i - REACH); at <= std::min(size - 1, i + REACH); at++) {
    const int64_t into = adjoint ? at : i, from = adjoint ? i : at;
    for (int k = 0; k < TAPS; k++)
      if (reflected(into + k - REACH, size) == from) out[at - i + REACH] += window.taps[k];
  }
}

// out[x] = sum_k taps[k] in[x + k step]
template <typename T>
void along(const T* in, T* out, int64_t length, int64_t step, const T* taps) {
  const T a = taps[0], b = taps[1], c = taps[2], d = taps[3], e = taps[4], f = taps[5];
#pragma omp simd
  for (int64_t x = 0; x < length; x++)
    out[x] = a * (in[x] + in[x + 10 * step]) + b * (in[x + step] + in[x + 9 * step]) +
             c * (in[x + 2 * step] + in[x + 8 * step]) + d * (in[x + 3 * step] + in[x + 7 * step]) +
             e * (in[x + 4 * step] + in[x + 6 * step]) + f * in[x + 5 * step];
}

// out[x] = sum_k taps[k] rows[k][x]
template <typename T>
void across(const T* const* rows, T* out, int64_t length, const T* taps) {
  const T *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5],
          *g = rows[6], *h = rows[7], *i = rows[8], *j = rows[9], *k = rows[10];
#pragma omp simd
  for (int64_t x = 0; x < length; x++)
    out[x] = taps[0] * a[x] + taps[1] * b[x] + taps[2] * c[x] + taps[3] * d[x] + taps[4] * e[x] +
             taps[5] * f[x] + taps[6] * g[x] + taps[7] * h[x] + taps[8] * i[x] + taps[9] * j[x] +
             taps[10] * k[x];
}

// The last TAPS rows of several maps.
template <typename T>
struct Ring {
  int64_t maps, length;
  std::vector<T> values;
  Ring(int64_t maps, int64_t length) : maps(maps), length(length), values(TAPS * maps * length) {}
  T* row(int64_t i, int64_t map) { return &values[((i % TAPS) * maps + map) * length]; }
  void filter(int64_t i, int64_t size, int64_t map, const T* taps, T* out) {
    const T* rows[TAPS];  // what is outside weighs nothing
    for (int k = 0; k < TAPS; k++)
      rows[k] = row(std::clamp<int64_t>(i + k - REACH, 0, size - 1), map);
    across(rows, out, length, taps);
  }
};

// What a thread works in.
template <typename T>
struct Strip {
  const Job<T>& job;
  const T *image, *target;  // of one picture
  int64_t length, pad;
  Window<T> window;
  Ring<T> filtered;     // along x: image, target, the sum of their squares, their product
  Ring<T> derivatives;  // of SSIM by the filtered image, its squares and the products; along x too
  std::vector<T> padded[4], moments[4], slopes[3], wide;

  Strip(const Job<T>& job, int64_t picture)
      : job(job), length(job.width * job.channels), pad(REACH * job.channels),
        filtered(4, length), derivatives(3, length), wide(length + 2 * pad) {
    image = job.image + picture * job.height * length;
    target = job.target + picture * job.height * length;
    for (auto& each : padded) each.resize(length + 2 * pad);
    for (auto& each : moments) each.resize(length);
    for (auto& each : slopes) each.resize(length + 4 * pad);
  }

  void reflect(const T* row, T* out) const {
    const int64_t c = job.channels;
    std::copy(row, row + length, out + pad);
    for (int64_t q = 1; q <= REACH; q++) {
      std::copy(row + q * c, row + (q + 1) * c, out + pad - q * c);
      std::copy(row + length - (q + 1) * c, row + length - q * c, out + pad + length + (q - 1) * c);
    }
  }

  void filter_along(int64_t i) {
    T *x = padded[0].data(), *y = padded[1].data(), *s = padded[2].data(), *p = padded[3].data();
    reflect(image + i * length, x);
    reflect(target + i * length, y);
#pragma omp simd
    for (int64_t at = 0; at < length + 2 * pad; at++) {
      s[at] = x[at] * x[at] + y[at] * y[at];
      p[at] = x[at] * y[at];
    }
    for (int map = 0; map < 4; map++)
      along(padded[map].data(), filtered.row(i, map), length, job.channels, window.taps);
  }

  // SSIM of row i, summed; where a gradient is wanted, its derivatives, filtered along x.
  double similarity(int64_t i) {
    T taps[TAPS];
    weights(window, i, job.height, false, taps);
    for (int map = 0; map < 4; map++)
      filtered.filter(i, job.height, map, taps, moments[map].data());
    const T *m1 = moments[0].data(), *m2 = moments[1].data(), *s = moments[2].data(),
            *p = moments[3].data();
    T *by_mean = slopes[0].data() + 2 * pad, *by_square = slopes[1].data() + 2 * pad,
      *by_product = slopes[2].data() + 2 * pad, *ssim = wide.data();
#pragma omp simd
    for (int64_t x = 0; x < length; x++) {
      const T both = m1[x] * m2[x], squares = m1[x] * m1[x] + m2[x] * m2[x];
      const T a1 = 2 * both + T(C1), a2 = 2 * (p[x] - both) + T(C2);
      const T b1 = squares + T(C1), b2 = (s[x] - squares) + T(C2);
      const T per = 1 / (b1 * b2 + T(EPSILON));
      const T value = a1 * a2 * per;
      ssim[x] = value;
      by_mean[x] = 2 * per * (m2[x] * (a2 - a1) - value * m1[x] * (b2 - b1));
      by_square[x] = -value * b1 * per;
      by_product[x] = 2 * a1 * per;
    }
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int64_t x = 0; x < length; x++) sum += ssim[x];
    if (job.gradient)
      for (int map = 0; map < 3; map++) spread_along(slopes[map].data(), derivatives.row(i, map));
    return sum;
  }

  // The adjoint of a filter along x: `in` has 2 pad zeros to both sides. What fell on a reflected
  // pixel returns to the pixel.
  void spread_along(const T* in, T* out) {
    const int64_t c = job.channels;
    along(in, wide.data(), length + 2 * pad, c, window.taps);
    const T* inside = wide.data() + pad;
    std::copy(inside, inside + length, out);
    for (int64_t q = 1; q <= REACH; q++)
      for (int64_t channel = 0; channel < c; channel++) {
        out[q * c + channel] += inside[-q * c + channel];
        out[length - (q + 1) * c + channel] += inside[length + (q - 1) * c + channel];
      }
  }

  void gradient(int64_t picture, int64_t i) {
    T taps[TAPS];
    weights(window, i, job.height, true, taps);
    for (int map = 0; map < 3; map++)
      derivatives.filter(i, job.height, map, taps, moments[map].data());
    const double count = double(job.pictures) * job.height * length;
    const T of_l1 = T((1 - job.weight) / count), of_ssim = T(-job.weight / count);
    const T *x = image + i * length, *y = target + i * length;
    const T *mean = moments[0].data(), *square = moments[1].data(), *product = moments[2].data();
    T* out = job.gradient + (picture * job.height + i) * length;
#pragma omp simd
    for (int64_t at = 0; at < length; at++) {
      const T difference = x[at] - y[at];
      const T sign = T(difference > 0) - T(difference < 0);
      out[at] = of_l1 * sign +
                of_ssim * (mean[at] + 2 * x[at] * square[at] + y[at] * product[at]);
    }
  }

  double distance(int64_t i) const {
    const T *x = image + i * length, *y = target + i * length;
    double sum = 0;
#pragma omp simd reduction(+ : sum)
    for (int64_t at = 0; at < length; at++) sum += std::abs(x[at] - y[at]);
    return sum;
  }

  // Rows first ... last - 1 of the picture.
  void work(int64_t picture, int64_t first, int64_t last) {
    const int64_t halo = job.gradient ? REACH : 0, height = job.height;
    const int64_t from = std::max<int64_t>(0, first - halo), to = std::min(height, last + halo);
    int64_t read = std::max<int64_t>(0, from - REACH);
    for (int64_t i = from; i < to + halo; i++) {
      if (i < to) {
        for (; read < std::min(height, i + REACH + 1); read++) filter_along(read);
        const double ssim = similarity(i);
        if (i >= first && i < last) {
          job.sums[2 * (picture * height + i)] = distance(i);
          job.sums[2 * (picture * height + i) + 1] = ssim;
        }
      }
      if (job.gradient && i - halo >= first && i - halo < last) gradient(picture, i - halo);
    }
  }
};

// 0, or 1 where there was no memory.
template <typename T>
int run(const Job<T>& job) {
  const int64_t threads = std::max<int64_t>(1, std::min(job.threads, job.height));
  const int64_t parts = std::max<int64_t>(1, (threads + job.pictures - 1) / job.pictures);
  return !over_threads(job.threads, job.pictures * parts, [&](int64_t t) {
    const int64_t picture = t / parts, part = t % parts;
    Strip<T>(job, picture)
        .work(picture, part * job.height / parts, (part + 1) * job.height / parts);
  });
}

}  // namespace

extern "C" {
int photometric_float32(const Job<float>* job) { return run(*job); }
int photometric_float64(const Job<double>* job) { return run(*job); }
}
