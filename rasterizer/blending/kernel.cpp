// Blending, forward and backward, a tile at a time: see composite.py for the equations and
// cpp_backend.py for the caller. Threads take tiles from a counter; each works in buffers that stay
// in its cache.
//
// A tile has side * side pixels; p runs over them row by row. Its Gaussians are members[starts[t]]
// ... front to back. A Gaussian's exponent at the pixel (x, y), measured from the tile's centre, is
// c0 + (cx + cxx x + cxy y) x + (cy + cyy y) y: formed from the whitened offset of its mean from
// that centre, so that nothing cancels. Only the rows of pixels that its ellipse reaches are
// visited: elsewhere alpha is zero.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <thread>
#include <vector>

namespace {

constexpr int GEOMETRY = 6;  // x, y, w0, w1, w2, log opacity; then the features
constexpr int BLOCK = 16;    // Gaussians between two tests of the stop, and two checkpoints

template <typename T>
struct Job {
  const T* table;              // [m, GEOMETRY + depth]
  const int64_t* members;      // [pairs]
  const int64_t* starts;       // [columns * rows + 1]
  const int64_t* slots;        // [pairs]
  int64_t columns, rows, side, width, height, depth, threads;
  double log_alpha_min, log_alpha_max, alpha_min, stop;
  T* features;                 // [height, width, depth]
  T* transmittance;            // [height, width]
  int64_t* median_index;       // [height, width], or null
  int64_t* visited;            // [columns * rows]: Gaussians blended before the stop
  const int64_t* blocks;       // [columns * rows]: where each tile's blocks begin
  T* checkpoints;              // [blocks, side * side]: transmittance before each, or null
  const T* grad_features;      // [height, width, depth]
  const T* grad_transmittance; // [height, width]
  T* gradients;                // [pairs, GEOMETRY + depth], by slot; zero
};

// exp on [-87, 1] (double: [-700, 1]), to an ulp or two: 2^n times the Taylor series of what
// remains, |r| <= ln2 / 2.
inline float exponential(float x) {
  const float n = std::nearbyint(x * 1.44269504f);
  const float r = std::fma(n, 1.90465420e-09f, std::fma(n, -0.693147183f, x));
  float s = 1.0f / 5040;
  s = s * r + 1.0f / 720, s = s * r + 1.0f / 120, s = s * r + 1.0f / 24, s = s * r + 1.0f / 6;
  s = s * r + 0.5f, s = s * r + 1.0f, s = s * r + 1.0f;
  const int32_t bits = (static_cast<int32_t>(n) + 127) << 23;
  float power;
  std::memcpy(&power, &bits, sizeof power);
  return s * power;
}
inline double exponential(double x) { return std::exp(x); }

template <typename T>
struct Splat {
  T c0, cx, cy, cxx, cxy, cyy;
  T dx, dy, u, v;
  int64_t begin, end;  // pixels of the rows that its ellipse reaches
};

template <typename T>
struct Tile {
  const Job<T>& job;
  int64_t index, first, count, left, top, columns, rows, pixels;
  T centre_x, centre_y;

  Tile(const Job<T>& job, int64_t index)
      : job(job), index(index), first(job.starts[index]), count(job.starts[index + 1] - first),
        left(index % job.columns * job.side), top(index / job.columns * job.side),
        columns(std::min(job.side, job.width - left)), rows(std::min(job.side, job.height - top)),
        pixels(job.side * rows),
        centre_x(left + T(0.5) * job.side), centre_y(top + T(0.5) * job.side) {}

  const T* row(int64_t i) const {
    return job.table + job.members[first + i] * (GEOMETRY + job.depth);
  }

  Splat<T> splat(int64_t i) const {
    const T* g = row(i);
    const T w0 = g[2], w1 = g[3], w2 = g[4];
    Splat<T> s;
    s.dx = centre_x - g[0], s.dy = centre_y - g[1];
    s.u = w0 * s.dx, s.v = w1 * s.dx + w2 * s.dy;
    s.c0 = g[5] - T(0.5) * (s.u * s.u + s.v * s.v);
    s.cx = -(s.u * w0 + s.v * w1), s.cy = -(s.v * w2);
    s.cxx = T(-0.5) * (w0 * w0 + w1 * w1), s.cxy = -(w1 * w2), s.cyy = T(-0.5) * w2 * w2;
    // |y + dy| <= radius sigma_y, with sigma_y = |(w0, w1)| / (w0 w2); a row too many is harmless
    T reach = std::sqrt(std::max(T(0), T(2) * (g[5] - T(job.log_alpha_min)))) * T(1.001) *
                        std::sqrt(w0 * w0 + w1 * w1) / (w0 * w2) + T(1);
    if (!(reach < T(1e9))) reach = T(1e9);  // all rows; no cast of what has no integer
    const T middle = T(0.5) * job.side - s.dy;
    const T low = std::min(std::max(middle - reach, T(0)), T(rows));
    const T high = std::min(std::max(middle + reach, T(0)), T(rows));
    s.begin = int64_t(low) * job.side;
    s.end = std::max(s.begin, int64_t(std::ceil(high)) * job.side);
    return s;
  }
};

// What a thread works in: planes of pixels. `in_front` is the transmittance in front of each
// Gaussian of a block; `behind` what lies behind a Gaussian adds to the loss; `above_half` how many
// Gaussians leave a transmittance above one half.
template <typename T>
struct Buffers {
  std::vector<T> x, y, transmittance, color, alpha, in_front, behind, value, upstream;
  std::vector<T> above_half;
  Splat<T> block[BLOCK];

  explicit Buffers(const Job<T>& job) {
    const int64_t q = job.side * job.side;
    for (auto* plane : {&x, &y, &transmittance, &behind, &value, &above_half}) plane->resize(q);
    for (auto* planes : {&alpha, &in_front}) planes->resize(BLOCK * q);
    for (auto* planes : {&color, &upstream}) planes->resize(std::max<int64_t>(1, job.depth) * q);
    for (int64_t p = 0; p < q; p++) {
      x[p] = p % job.side + T(0.5) - T(0.5) * job.side;
      y[p] = p / job.side + T(0.5) - T(0.5) * job.side;
    }
  }
};

template <typename T>
inline T exponent(const Splat<T>& s, T x, T y) {
  return s.c0 + (s.cx + s.cxx * x + s.cxy * y) * x + (s.cy + s.cyy * y) * y;
}

// alpha over the splat's rows of pixels; the exponent never goes where exp underflows
template <typename T>
inline void alphas(const Job<T>& job, const Splat<T>& s, const T* x, const T* y, T* alpha) {
  const T least = sizeof(T) == 4 ? T(-87) : T(-700);  // where exp is still a normal number
  const T low = std::max(T(job.log_alpha_min) - T(1e-3), least), high = T(job.log_alpha_max);
  const T floor = T(job.alpha_min) * (1 - std::numeric_limits<T>::epsilon());
#pragma omp simd
  for (int64_t p = s.begin; p < s.end; p++) {
    const T e = std::min(std::max(exponent(s, x[p], y[p]), low), high);
    const T a = exponential(e);
    alpha[p] = a > floor ? a : T(0);
  }
}

// FUSED: 3 where there are just as many features, colours: one loop does all; otherwise 0.
template <typename T, int FUSED>
void forward(const Job<T>& job, int64_t index, Buffers<T>& b) {
  const Tile<T> tile(job, index);
  const int64_t q = tile.pixels, plane = job.side * job.side;
  T *x = b.x.data(), *y = b.y.data(), *alpha = b.alpha.data();
  T *transmittance = b.transmittance.data(), *above_half = b.above_half.data();
  for (int64_t p = 0; p < q; p++) transmittance[p] = p % job.side < tile.columns;
  std::fill_n(b.color.data(), job.depth * plane, T(0));
  std::fill_n(above_half, q, T(0));
  int64_t i = 0;
  for (; i < tile.count; i++) {
    if (i % BLOCK == 0) {
      // below `least`, arithmetic is 10 times slower: products become denormal
      constexpr T least = std::numeric_limits<T>::min() / std::numeric_limits<T>::epsilon();
      T most = 0;
#pragma omp simd reduction(max : most)
      for (int64_t p = 0; p < q; p++) {
        transmittance[p] = transmittance[p] > least ? transmittance[p] : T(0);
        most = std::max(most, transmittance[p]);
      }
      if (job.stop > 0 && most <= T(job.stop)) break;
      if (job.checkpoints)
        std::copy_n(transmittance, q, job.checkpoints + (job.blocks[index] + i / BLOCK) * plane);
    }
    const Splat<T> s = tile.splat(i);
    alphas(job, s, x, y, alpha);
    const T* feature = tile.row(i) + GEOMETRY;
    T* color = b.color.data();
#pragma omp simd
    for (int64_t p = s.begin; p < s.end; p++) {
      const T weight = alpha[p] * transmittance[p];
      transmittance[p] *= 1 - alpha[p];
      alpha[p] = weight;
      for (int c = 0; c < FUSED; c++) color[c * plane + p] += feature[c] * weight;
    }
    for (int64_t c = FUSED; c < job.depth; c++) {
      const T f = feature[c];
#pragma omp simd
      for (int64_t p = s.begin; p < s.end; p++) color[c * plane + p] += f * alpha[p];
    }
    if (job.median_index) {
#pragma omp simd
      for (int64_t p = 0; p < q; p++) above_half[p] += transmittance[p] > T(0.5) ? T(1) : T(0);
    }
  }
  job.visited[index] = i;
  for (int64_t r = 0; r < tile.rows; r++) {
    for (int64_t c = 0; c < tile.columns; c++) {
      const int64_t p = r * job.side + c, at = (tile.top + r) * job.width + tile.left + c;
      job.transmittance[at] = transmittance[p];
      for (int64_t k = 0; k < job.depth; k++)
        job.features[at * job.depth + k] = b.color[k * plane + p];
      if (job.median_index)
        job.median_index[at] = transmittance[p] <= T(0.5)
                                   ? job.members[tile.first + int64_t(above_half[p])]
                                   : int64_t(-1);
    }
  }
}

// From the gradients by the quadratic (1, x, y, xx, xy, yy) to those by x, y, w0, w1, w2, log
// opacity.
template <typename T>
void chain(const Splat<T>& s, const T* g, const T* sum, T* out) {
  const T w0 = g[2], w1 = g[3], w2 = g[4];
  const T gu = -(s.u * sum[0] + w0 * sum[1]);
  const T gv = -(s.v * sum[0] + w1 * sum[1] + w2 * sum[2]);
  out[0] = -(w0 * gu + w1 * gv);
  out[1] = -(w2 * gv);
  out[2] = gu * s.dx - s.u * sum[1] - w0 * sum[3];
  out[3] = gv * s.dx - s.v * sum[1] - w1 * sum[3] - w2 * sum[4];
  out[4] = gv * s.dy - s.v * sum[2] - w1 * sum[4] - w2 * sum[5];
  out[5] = sum[0];
}

template <typename T, int FUSED>
void backward(const Job<T>& job, int64_t index, Buffers<T>& b) {
  const Tile<T> tile(job, index);
  const int64_t q = tile.pixels, plane = job.side * job.side, visited = job.visited[index];
  T *x = b.x.data(), *y = b.y.data(), *value = b.value.data();
  T *transmittance = b.transmittance.data(), *behind = b.behind.data();
  if (!visited) return;

  std::fill_n(b.upstream.data(), job.depth * plane, T(0));
  std::fill_n(behind, q, T(0));
  for (int64_t r = 0; r < tile.rows; r++) {
    for (int64_t c = 0; c < tile.columns; c++) {
      const int64_t p = r * job.side + c, at = (tile.top + r) * job.width + tile.left + c;
      behind[p] = job.grad_transmittance[at] * job.transmittance[at];
      for (int64_t k = 0; k < job.depth; k++)
        b.upstream[k * plane + p] = job.grad_features[at * job.depth + k];
    }
  }

  const T high = T(job.log_alpha_max);
  for (int64_t start = (visited - 1) / BLOCK * BLOCK; start >= 0; start -= BLOCK) {
    const int64_t size = std::min<int64_t>(BLOCK, visited - start);
    std::copy_n(job.checkpoints + (job.blocks[index] + start / BLOCK) * plane, q, transmittance);
    for (int64_t i = 0; i < size; i++) {
      const Splat<T>& s = b.block[i] = tile.splat(start + i);
      T *alpha = b.alpha.data() + i * q, *in_front = b.in_front.data() + i * q;
      alphas(job, s, x, y, alpha);
#pragma omp simd
      for (int64_t p = s.begin; p < s.end; p++) {
        in_front[p] = transmittance[p];
        transmittance[p] *= 1 - alpha[p];
      }
    }
    for (int64_t i = size - 1; i >= 0; i--) {
      const Splat<T>& s = b.block[i];
      const T *alpha = b.alpha.data() + i * q, *in_front = b.in_front.data() + i * q;
      const T* g = tile.row(start + i);
      T* out = job.gradients + job.slots[tile.first + start + i] * (GEOMETRY + job.depth);
      const T *feature = g + GEOMETRY, *upstream = b.upstream.data();
      if constexpr (!FUSED) {
        std::fill(value + s.begin, value + s.end, T(0));
        for (int64_t c = 0; c < job.depth; c++) {
          const T* up = upstream + c * plane;
          const T f = feature[c];
          T sum = 0;
#pragma omp simd reduction(+ : sum)
          for (int64_t p = s.begin; p < s.end; p++) {
            value[p] += f * up[p];
            sum += alpha[p] * in_front[p] * up[p];
          }
          out[GEOMETRY + c] = sum;
        }
      }
      T s1 = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0, f0 = 0, f1 = 0, f2 = 0;
#pragma omp simd reduction(+ : s1, sx, sy, sxx, sxy, syy, f0, f1, f2)
      for (int64_t p = s.begin; p < s.end; p++) {
        const T weight = alpha[p] * in_front[p];
        T gain = FUSED ? T(0) : value[p];
        if constexpr (FUSED == 3) {
          const T u0 = upstream[p], u1 = upstream[plane + p], u2 = upstream[2 * plane + p];
          gain = feature[0] * u0 + feature[1] * u1 + feature[2] * u2;
          f0 += weight * u0, f1 += weight * u1, f2 += weight * u2;
        }
        // no gradient where alpha is held at its cap
        const T slope = exponent(s, x[p], y[p]) > high ? T(0) : alpha[p];
        const T grad = (gain * in_front[p] - behind[p] / (1 - alpha[p])) * slope;
        behind[p] += gain * weight;
        const T gx = grad * x[p], gy = grad * y[p];
        s1 += grad, sx += gx, sy += gy, sxx += gx * x[p], sxy += gx * y[p], syy += gy * y[p];
      }
      if constexpr (FUSED == 3) out[GEOMETRY] = f0, out[GEOMETRY + 1] = f1, out[GEOMETRY + 2] = f2;
      const T sums[GEOMETRY] = {s1, sx, sy, sxx, sxy, syy};
      chain(s, g, sums, out);
    }
  }
}

// 0, or 1 where there was no memory: an exception must not leave, Python would not see it.
template <typename T>
int each_tile(const Job<T>& job, void (*work)(const Job<T>&, int64_t, Buffers<T>&)) {
  std::atomic<int64_t> next{0};
  const int64_t tiles = job.columns * job.rows;
  std::atomic<int> failed{0};
  auto loop = [&] {
    try {
      Buffers<T> buffers(job);
      for (int64_t t; (t = next.fetch_add(1)) < tiles;) work(job, t, buffers);
    } catch (...) {
      failed = 1;
    }
  };
  std::vector<std::thread> others;
  try {
    for (int64_t i = 1; i < std::min(job.threads, tiles); i++) others.emplace_back(loop);
  } catch (...) {
  }  // the threads that did start will do
  loop();
  for (auto& thread : others) thread.join();
  return failed;
}

template <typename T>
int run(const Job<T>& job, bool back) {
  const bool colors = job.depth == 3;
  return each_tile(job, back ? (colors ? backward<T, 3> : backward<T, 0>)
                      : (colors ? forward<T, 3> : forward<T, 0>));
}

}  // namespace

extern "C" {
int forward_float32(const Job<float>* job) { return run(*job, false); }
int forward_float64(const Job<double>* job) { return run(*job, false); }
int backward_float32(const Job<float>* job) { return run(*job, true); }
int backward_float64(const Job<double>* job) { return run(*job, true); }
}
