// From a scene's Gaussians to the table and the lists of tiles that are blended, and back to the
// scene's gradients: preprocess.py, project.py, harmonics.py and tiles.py in one, over threads.
// kernel.py calls it. Every function returns a negative number where it cannot do its work: REFUSED
// where a number is not finite (the caller lets the Python files find it and name it), NO_MEMORY.

#include <algorithm>
#include <cmath>

#include "bins.h"
#include "harmonics.h"
#include "job.h"
#include "numbers.h"
#include "project.h"

namespace {

constexpr int64_t REFUSED = -1, NO_MEMORY = -2;
constexpr int64_t LEAST = 1 << 12;  // Gaussians that are worth a thread

// Whether all are finite; `below`, `above`: whether -inf, and inf, are allowed.
template <typename T>
bool finite(const T* values, int64_t count, bool below, bool above) {
  const T low = below ? -std::numeric_limits<T>::infinity() : std::numeric_limits<T>::lowest();
  const T high = above ? std::numeric_limits<T>::infinity() : std::numeric_limits<T>::max();
  int bad = 0;
#pragma omp simd reduction(| : bad)
  for (int64_t i = 0; i < count; i++) bad |= !(values[i] >= low && values[i] <= high);
  return !bad;
}

// Whether each of LANES Gaussians may touch the rectangle: its sphere's bound. What is not drawn
// may be kept, what is drawn must be.
template <typename T>
void keep_near(const Job<T>& job, const View<T>& v, int64_t first, uint8_t* keep) {
  T x[LANES], y[LANES], z[LANES], size[LANES], logit[LANES];
  for (int i = 0; i < LANES; i++) {
    const int64_t row = std::min(first + i, job.count - 1);
    const T *mean = job.means + 3 * row, *scale = job.log_scales + 3 * row;
    x[i] = mean[0], y[i] = mean[1], z[i] = mean[2], logit[i] = job.logits[row];
    size[i] = std::max(std::max(scale[0], scale[1]), scale[2]);
  }
  const T low_x = T(v.low_x), high_x = T(v.high_x), low_y = T(v.low_y), high_y = T(v.high_y);
  const T near = T(job.near), floor = T(job.log_alpha_min);
  const T shift_x = T(job.centre_x - job.left), shift_y = T(job.centre_y - job.top);
  const T least_logit = T(job.least_logit), width = T(job.width), height = T(job.height);
#pragma omp simd
  for (int i = 0; i < LANES; i++) {
    const double a = x[i], b = y[i], c = z[i];
    const double depth = v.r[6] * a + v.r[7] * b + v.r[8] * c + v.t[2];
    bool kept = depth > job.near && depth <= job.far && logit[i] >= least_logit;
    const T at_x = T(v.r[0] * a + v.r[1] * b + v.r[2] * c + v.t[0]);
    const T at_y = T(v.r[3] * a + v.r[4] * b + v.r[5] * c + v.t[1]);
    const T per_distance = v.orthographic ? T(1) : T(1) / std::max(T(depth), near);
    const T sigma = exponential(size[i]) * per_distance;
    const T cutoff = std::sqrt(2 * std::max(std::min(logit[i], T(0)) - floor, T(0)));
    const auto beside = [&](T at, T focal, T low, T high, T shift, T extent) {
      const T slope = at * per_distance, inside = held(slope, low, high);
      const T stretch = sigma * (std::sqrt(1 + inside * inside) * focal), position = slope * focal;
      // float32 rounds a position by 1e-7 of it: much where a sensor is shifted by 1e7 pixels
      const T rounding = 1 + T(1e-6) * std::min(std::abs(position), T(1e30));
      const T reach = cutoff * std::sqrt(stretch * stretch + v.blur) * T(1.001) + rounding;
      const T offset = position + shift;
      return offset < -reach || offset > extent + reach;
    };
    kept = kept && !beside(at_x, v.fx, low_x, high_x, shift_x, width);
    kept = kept && !beside(at_y, v.fy, low_y, high_y, shift_y, height);
    keep[i] = kept;
  }
}

template <typename T>
int64_t cull(Job<T>& job) {
  Scratch& scratch = *static_cast<Scratch*>(job.scratch);
  int32_t* rows = scratch.rows.at_least(job.count + LANES);
  const View<T> view(job);
  std::vector<int64_t> begins(job.threads, 0), found(job.threads, 0);
  std::atomic<bool> good{true};
  in_parallel(job.threads, job.count, LEAST, [&](int64_t begin, int64_t end, int64_t thread) {
    int64_t kept = begin;
    for (int64_t part = begin; part < end; part += 1024) {  // stays in the cache between the two
      const int64_t last = std::min(end, part + 1024), many = last - part;
      if (!finite(job.means + 3 * part, 3 * many, false, false) ||
          !finite(job.quats + 4 * part, 4 * many, false, false) ||
          !finite(job.log_scales + 3 * part, 3 * many, true, false) ||
          !finite(job.logits + part, many, true, true))
        good = false;
      for (int64_t i = part; i < last; i += LANES) {
        uint8_t keep[LANES];
        keep_near(job, view, i, keep);
        for (int64_t row = i; row < std::min(last, i + LANES); row++) {
          rows[kept] = int32_t(row);
          kept += keep[row - i];
        }
      }
    }
    begins[thread] = begin, found[thread] = kept - begin;
  });
  if (!good) return REFUSED;
  int64_t total = 0;
  for (int64_t t = 0; t < job.threads; t++) {
    std::copy_n(rows + begins[t], found[t], rows + total);  // never to the right
    total += found[t];
  }
  return total;
}

// LANES Gaussians of the table, a number of each side by side.
template <typename T>
struct Lanes {
  T mean[3][LANES], quat[4][LANES], log_scale[3][LANES], logit[LANES];

  void load(const Job<T>& job, int64_t first, int64_t count) {
    for (int64_t i = 0; i < LANES; i++) {
      const int64_t row = job.rows[first + std::min(i, count - 1)];
      for (int k = 0; k < 3; k++) mean[k][i] = job.means[3 * row + k];
      for (int k = 0; k < 4; k++) quat[k][i] = job.quats[4 * row + k];
      for (int k = 0; k < 3; k++) log_scale[k][i] = job.log_scales[3 * row + k];
      logit[i] = job.logits[row];
    }
  }
  Vec<T> centre(int i) const { return {mean[0][i], mean[1][i], mean[2][i]}; }
  Vec<T> scales(int i) const {
    return {exponential(log_scale[0][i]), exponential(log_scale[1][i]),
            exponential(log_scale[2][i])};
  }
  Rotation<T> turned(int i) const {
    return rotation(quat[0][i], quat[1][i], quat[2][i], quat[3][i]);
  }
};

// Unit vectors from the camera's centre, and what they were divided by: twice, as
// view_directions and harmonics.colors do.
struct Direction {
  Vec<double> unit;
  double first, second;
};

template <typename T>
inline Direction direction(const View<T>& v, Vec<T> mean) {
  const double a = v.r[0] * v.t[0] + v.r[3] * v.t[1] + v.r[6] * v.t[2],
               b = v.r[1] * v.t[0] + v.r[4] * v.t[1] + v.r[7] * v.t[2],
               c = v.r[2] * v.t[0] + v.r[5] * v.t[1] + v.r[8] * v.t[2];
  const Vec<double> ray = {mean.x + a, mean.y + b, mean.z + c};
  Direction d;
  d.first = std::max(std::sqrt(dot(ray, ray)), 1e-12);
  const Vec<double> once = (1 / d.first) * ray;
  d.second = std::max(std::sqrt(dot(once, once)), 1e-12);
  d.unit = (1 / d.second) * once;
  return d;
}

// Harmonics at the directions of LANES Gaussians.
template <typename T, int BANDS>
void bases(const View<T>& v, const Lanes<T>& in, T (*out)[LANES]) {
#pragma omp simd
  for (int i = 0; i < LANES; i++) {
    const Direction d = direction(v, in.centre(i));
    basis(Vec<T>{T(d.unit.x), T(d.unit.y), T(d.unit.z)}, BANDS, &out[0][i], LANES);
  }
}

template <typename T, int BANDS>
bool colors(const Job<T>& job, const View<T>& v, const Lanes<T>& in, int64_t first, int64_t count) {
  T y[BANDS][LANES];
  if (BANDS == 1) {
    std::fill_n(y[0], LANES, T(C0));
  } else {
    bases<T, BANDS>(v, in, y);
  }
  const int64_t columns = GEOMETRY + 3 + job.with_depth;
  bool good = true;
  for (int64_t i = 0; i < count; i++) {
    const T* sh = job.sh + int64_t(job.rows[first + i]) * BANDS * 3;
    T color[3] = {T(0), T(0), T(0)};
    for (int k = 0; k < BANDS; k++)
      for (int c = 0; c < 3; c++) color[c] += y[k][i] * sh[3 * k + c];
    uint8_t shown = 0;
    for (int c = 0; c < 3; c++) {
      const T value = T(0.5) + color[c];
      good &= std::isfinite(value);  // as it is not where a coefficient is not
      shown |= uint8_t(value >= 0) << c;
      job.table[(first + i) * columns + GEOMETRY + c] = std::max(value, T(0));
    }
    job.shown[first + i] = shown;
  }
  return good;
}

template <typename T>
bool colors_of(const Job<T>& job, const View<T>& v, const Lanes<T>& in, int64_t first,
               int64_t count) {
  switch (job.bands) {
    case 1: return colors<T, 1>(job, v, in, first, count);
    case 4: return colors<T, 4>(job, v, in, first, count);
    case 9: return colors<T, 9>(job, v, in, first, count);
    case 16: return colors<T, 16>(job, v, in, first, count);
    default: return colors<T, 25>(job, v, in, first, count);
  }
}

// What LANES Gaussians become on the picture: columns of the table, depths, ellipses, and the
// number of tiles of each size that their bounding boxes take. Whether all of it is finite.
template <typename T>
bool project_lanes(const Job<T>& job, const View<T>& v, const Lanes<T>& in, int64_t first,
                   int64_t count, double* depths, T* shapes, double* tiles) {
  T out[GEOMETRY][LANES], shape[FOOTPRINT][LANES], taken[SIZES][LANES];
  double depth[LANES];
  int bad = 0;
  const T floor = T(job.log_alpha_min), least = T(job.alpha_min), clip = T(job.radius_clip);
  const T width = T(job.width), height = T(job.height);
  const bool antialiased = job.antialiased;
#pragma omp simd reduction(| : bad)
  for (int i = 0; i < LANES; i++) {
    const Linearised<T> l = linearise(v, in.centre(i));
    const Ellipse<T> e = ellipse(v.blur, l, in.turned(i), in.scales(i));
    const T x = T(v.focal_x * l.slope_x + v.centre_x) - v.left;
    const T y = T(v.focal_y * l.slope_y + v.centre_y) - v.top;
    const T covariance[4] = {e.xx, e.xy, e.yy, e.conditional * (e.xx / e.yy)};
    const T none = T(0) * (x + y + e.xx + e.xy + e.yy + covariance[3] + e.root + e.w1 + e.w2);
    bad |= !(none == 0);
    T log_opacity = log_sigmoid(in.logit[i]);
    if (antialiased) log_opacity += log_compensation(e);
    T radius = std::sqrt(std::max(2 * (log_opacity - floor), T(0)));
    const T wide = std::sqrt(e.xx), high = std::sqrt(e.yy);
    const bool small = clip > 0 && std::ceil(radius * std::max(wide, high)) <= clip;
    const bool faint = 1 / (1 + exponential(-in.logit[i])) < least;
    const bool hidden = small || faint || log_opacity < floor - T(1e-3);
    log_opacity = small || faint ? 2 * floor : log_opacity;
    radius = hidden ? T(0) : radius;
    depth[i] = l.z;
    out[0][i] = x, out[1][i] = y, out[2][i] = e.root, out[3][i] = e.w1, out[4][i] = e.w2;
    out[5][i] = log_opacity;
    footprint(x, y, covariance, radius, &shape[0][i], LANES);
    shape[7][i] = hidden ? T(-1) : shape[7][i];
    const auto span = [&](T at, T half, T extent) {
      const T low = held(at - half, T(0), extent);
      return std::max(held(at + half, T(0), extent) - low, T(0));
    };
    const T across = span(x, radius * wide, width), down = span(y, radius * high, height);
    for (int s = 0; s < SIZES; s++) {
      const T per = T(1) / TILE_SIZES[s];
      taken[s][i] = hidden ? T(0) : (across * per + 1) * (down * per + 1);
    }
  }
  if (bad) return false;
  const int64_t columns = GEOMETRY + 3 + job.with_depth;
  for (int64_t i = 0; i < count; i++) {
    T* row = job.table + (first + i) * columns;
    for (int k = 0; k < GEOMETRY; k++) row[k] = out[k][i];
    for (int k = 0; k < FOOTPRINT; k++) shapes[(first + i) * FOOTPRINT + k] = shape[k][i];
    if (job.with_depth) row[GEOMETRY + 3] = T(depth[i]);
    if (job.depths) job.depths[first + i] = T(depth[i]);
    depths[first + i] = depth[i];
    for (int s = 0; s < SIZES; s++) tiles[s] += taken[s][i];
  }
  return true;
}

template <typename T>
int64_t choose_tile_size(const Job<T>& job, const std::vector<double>& tiles) {
  double cheapest = std::numeric_limits<double>::infinity();
  int64_t chosen = TILE_SIZES[0];
  for (int s = 0; s < SIZES; s++) {
    double sum = 0;
    for (int64_t t = 0; t < job.threads; t++) sum += tiles[t * SIZES + s];
    const double cost = sum * (double(TILE_SIZES[s]) * TILE_SIZES[s] + job.pair_overhead);
    if (cost < cheapest) cheapest = cost, chosen = TILE_SIZES[s];
  }
  return chosen;
}

// Fills rows, table, depths, shown and firsts; finds the tile's size, and the spans.
template <typename T>
int64_t project(Job<T>& job) {
  Scratch& scratch = *static_cast<Scratch*>(job.scratch);
  const View<T> view(job);
  double* depths = scratch.depths.at_least(job.drawn);
  T* shapes = reinterpret_cast<T*>(scratch.footprints.at_least(job.drawn * FOOTPRINT));
  std::copy_n(scratch.rows.data(), job.drawn, job.rows);
  std::vector<double> tiles(job.threads * SIZES, 0.0);
  std::atomic<bool> good{true};
  in_parallel(job.threads, job.drawn, LEAST / 4, [&](int64_t begin, int64_t end, int64_t thread) {
    Lanes<T> lanes;
    for (int64_t i = begin; i < end; i += LANES) {
      const int64_t count = std::min<int64_t>(LANES, end - i);
      lanes.load(job, i, count);
      if (!project_lanes(job, view, lanes, i, count, depths, shapes, &tiles[thread * SIZES]) ||
          !colors_of(job, view, lanes, i, count))
        good = false;
    }
  });
  if (!good) return REFUSED;
  if (!job.tile_size) job.tile_size = choose_tile_size(job, tiles);
  job.tile_size = std::min(job.tile_size, std::max(job.width, job.height));
  job.columns = (job.width + job.tile_size - 1) / job.tile_size;
  job.tile_rows = (job.height + job.tile_size - 1) / job.tile_size;

  int64_t* first_span = scratch.first_span.at_least(job.drawn + 1);
  int32_t* top_row = scratch.rows.data();  // not needed any more
  count_rows(job, shapes, first_span, top_row);
  Span* spans = scratch.spans.at_least(first_span[job.drawn] + 1);
  const int64_t every = job.columns * job.tile_rows + 1;
  int64_t* counts = scratch.counts.at_least(every * job.threads);
  std::fill_n(counts, every * job.threads, 0);
  in_parallel(job.threads, job.drawn, LEAST / 4, [&](int64_t begin, int64_t end, int64_t thread) {
    fill_spans(job, shapes, first_span, top_row, spans, begin, end, counts + thread * every);
  });
  job.pairs = 0;
  for (int64_t i = 0; i < job.drawn; i++) {
    const int64_t here = job.firsts[i];
    job.firsts[i] = job.pairs, job.pairs += here;
  }
  return 0;
}

// Fills starts, members and slots.
template <typename T>
int64_t list(Job<T>& job) {
  Scratch& scratch = *static_cast<Scratch*>(job.scratch);
  const int64_t tiles = job.columns * job.tile_rows;
  int64_t *counts = scratch.counts.data(), running = 0, sum = 0;
  for (int64_t t = 0; t <= tiles; t++) {
    for (int64_t thread = 0; thread < job.threads; thread++)
      running += counts[thread * (tiles + 1) + t];
    job.starts[t] = sum;
    sum += running;
  }
  std::copy_n(job.starts, tiles, counts);
  const int64_t* first_span = scratch.first_span.data();
  const Span* spans = scratch.spans.data();
  int64_t visible;
  const uint64_t* order =
      depth_order(scratch, scratch.depths.data(), first_span, job.drawn, visible);
  for (int64_t rank = 0; rank < visible; rank++) {
    const int64_t i = uint32_t(order[rank]);
    int64_t slot = job.firsts[i];
    for (int64_t s = first_span[i]; s < first_span[i + 1]; s++)
      for (int64_t tile = spans[s].tile; tile < spans[s].tile + spans[s].count; tile++) {
        const int64_t at = counts[tile]++;
        job.members[at] = i, job.slots[at] = slot++;
      }
  }
  return 0;
}

// LANES Gaussians' rows of the table's gradient: sums over their pairs.
template <typename T>
struct Upstream {
  T of[GEOMETRY + 4][LANES];

  void load(const Job<T>& job, int64_t first, int64_t count) {
    const int64_t columns = GEOMETRY + 3 + job.with_depth;
    for (auto& row : of) std::fill_n(row, LANES, T(0));
    for (int64_t i = first; i < first + count; i++) {
      const int64_t end = i + 1 < job.drawn ? job.firsts[i + 1] : job.pairs;
      T sum[GEOMETRY + 4] = {};
      for (int64_t p = job.firsts[i]; p < end; p++)
        for (int64_t k = 0; k < columns; k++) sum[k] += job.pair_gradients[p * columns + k];
      for (int64_t k = 0; k < columns; k++) of[k][i - first] = sum[k];
      for (int c = 0; c < 3; c++)
        if (!(job.shown[i] >> c & 1)) of[GEOMETRY + c][i - first] = T(0);
    }
  }
};

// Gradients of the harmonics; and of the centres in the world, by the directions.
template <typename T, int BANDS>
void color_gradients(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                     const Upstream<T>& up, int64_t first, int64_t count, double (*mean)[LANES]) {
  T y[BANDS][LANES], by_basis[BANDS][LANES];
  if (BANDS == 1) {
    std::fill_n(y[0], LANES, T(C0));
  } else {
    bases<T, BANDS>(v, in, y);
  }
  for (int64_t i = 0; i < count; i++) {
    const int64_t row = job.rows[first + i];
    const T g[3] = {up.of[GEOMETRY][i], up.of[GEOMETRY + 1][i], up.of[GEOMETRY + 2][i]};
    if (job.grad_sh) {
      T* out = job.grad_sh + row * BANDS * 3;
      for (int k = 0; k < BANDS; k++)
        for (int c = 0; c < 3; c++) out[3 * k + c] = y[k][i] * g[c];
    }
    if (BANDS > 1 && job.grad_means) {
      const T* sh = job.sh + row * BANDS * 3;
      for (int k = 0; k < BANDS; k++)
        by_basis[k][i] = sh[3 * k] * g[0] + sh[3 * k + 1] * g[1] + sh[3 * k + 2] * g[2];
    }
  }
  if (BANDS == 1 || !job.grad_means) return;
  for (int64_t i = count; i < LANES; i++)
    for (int k = 0; k < BANDS; k++) by_basis[k][i] = T(0);
#pragma omp simd
  for (int i = 0; i < LANES; i++) {
    const Direction d = direction(v, in.centre(i));
    const Vec<T> unit = {T(d.unit.x), T(d.unit.y), T(d.unit.z)};
    const Vec<T> g = basis_gradient(unit, BANDS, &by_basis[0][i], LANES);
    Vec<double> by = {double(g.x), double(g.y), double(g.z)};
    by = (1 / d.second) * (by - (d.second > 1e-12 ? dot(by, d.unit) : 0.0) * d.unit);
    by = (1 / d.first) * (by - (d.first > 1e-12 ? dot(by, d.unit) : 0.0) * d.unit);
    mean[0][i] = by.x, mean[1][i] = by.y, mean[2][i] = by.z;
  }
}

template <typename T>
void color_gradients_of(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                        const Upstream<T>& up, int64_t first, int64_t count,
                        double (*mean)[LANES]) {
  switch (job.bands) {
    case 1: return color_gradients<T, 1>(job, v, in, up, first, count, mean);
    case 4: return color_gradients<T, 4>(job, v, in, up, first, count, mean);
    case 9: return color_gradients<T, 9>(job, v, in, up, first, count, mean);
    case 16: return color_gradients<T, 16>(job, v, in, up, first, count, mean);
    default: return color_gradients<T, 25>(job, v, in, up, first, count, mean);
  }
}

// Gradients of centres, rotations, scales and opacities; `mean` holds the directions' part.
template <typename T>
void geometry_gradients(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                        const Upstream<T>& up, int64_t first, int64_t count,
                        double (*mean)[LANES]) {
  T quat[4][LANES], scale[3][LANES], logit[LANES];
  const bool antialiased = job.antialiased;
#pragma omp simd
  for (int i = 0; i < LANES; i++) {
    const Linearised<T> l = linearise(v, in.centre(i));
    const Rotation<T> q = in.turned(i);
    const Vec<T> scales = in.scales(i);
    const Ellipse<T> e = ellipse(v.blur, l, q, scales);
    const T by_opacity = up.of[5][i];
    const GeometryGradient<T> g = geometry_gradient(
        v, l, q, scales, e, up.of[0][i], up.of[1][i], up.of[2][i], up.of[3][i], up.of[4][i],
        antialiased ? by_opacity : T(0), up.of[GEOMETRY + 3][i]);
    logit[i] = by_opacity / (1 + exponential(in.logit[i]));
    quat[0][i] = g.w, quat[1][i] = g.x, quat[2][i] = g.y, quat[3][i] = g.z;
    scale[0][i] = g.log_scales.x, scale[1][i] = g.log_scales.y, scale[2][i] = g.log_scales.z;
    mean[0][i] += v.r[0] * g.mean_x + v.r[3] * g.mean_y + v.r[6] * g.mean_z;
    mean[1][i] += v.r[1] * g.mean_x + v.r[4] * g.mean_y + v.r[7] * g.mean_z;
    mean[2][i] += v.r[2] * g.mean_x + v.r[5] * g.mean_y + v.r[8] * g.mean_z;
  }
  for (int64_t i = 0; i < count; i++) {
    const int64_t row = job.rows[first + i];
    if (job.grad_means)
      for (int k = 0; k < 3; k++) job.grad_means[3 * row + k] = T(mean[k][i]);
    if (job.grad_quats)
      for (int k = 0; k < 4; k++) job.grad_quats[4 * row + k] = quat[k][i];
    if (job.grad_log_scales)
      for (int k = 0; k < 3; k++) job.grad_log_scales[3 * row + k] = scale[k][i];
    if (job.grad_logits) job.grad_logits[row] = logit[i];
  }
}

// Zero in the rows [from, to) of every gradient.
template <typename T>
void clear(const Job<T>& job, int64_t from, int64_t to) {
  const auto zero = [&](T* values, int64_t width) {
    if (values) std::fill(values + from * width, values + to * width, T(0));
  };
  zero(job.grad_means, 3), zero(job.grad_quats, 4), zero(job.grad_log_scales, 3);
  zero(job.grad_logits, 1), zero(job.grad_sh, 3 * job.bands);
}

template <typename T>
int64_t backward(Job<T>& job) {
  const View<T> view(job);
  const bool geometry =
      job.grad_means || job.grad_quats || job.grad_log_scales || job.grad_logits;
  if (!job.drawn) clear(job, 0, job.count);
  in_parallel(job.threads, job.drawn, LEAST / 4, [&](int64_t begin, int64_t end, int64_t) {
    Lanes<T> lanes;
    Upstream<T> upstream;
    int64_t written = begin == 0 ? 0 : job.rows[begin];
    for (int64_t i = begin; i < end; i += LANES) {
      const int64_t count = std::min<int64_t>(LANES, end - i);
      for (int64_t j = i; j < i + count; written = job.rows[j++] + 1)
        if (job.rows[j] > written) clear(job, written, job.rows[j]);
      double mean[3][LANES] = {};
      lanes.load(job, i, count);
      upstream.load(job, i, count);
      color_gradients_of(job, view, lanes, upstream, i, count, mean);
      if (geometry) geometry_gradients(job, view, lanes, upstream, i, count, mean);
    }
    if (begin < end) clear(job, written, end < job.drawn ? job.rows[end] : job.count);
  });
  return 0;
}

template <typename T>
int64_t guarded(int64_t (*work)(Job<T>&), Job<T>* job) {  // Python would not see an exception
  try {
    return work(*job);
  } catch (...) {
    return NO_MEMORY;
  }
}

}  // namespace

extern "C" {
void* new_scratch() { return new (std::nothrow) Scratch; }
int64_t cull_float32(Job<float>* job) { return guarded(cull, job); }
int64_t cull_float64(Job<double>* job) { return guarded(cull, job); }
int64_t project_float32(Job<float>* job) { return guarded(project, job); }
int64_t project_float64(Job<double>* job) { return guarded(project, job); }
int64_t list_float32(Job<float>* job) { return guarded(list, job); }
int64_t list_float64(Job<double>* job) { return guarded(list, job); }
int64_t backward_float32(Job<float>* job) { return guarded(backward, job); }
int64_t backward_float64(Job<double>* job) { return guarded(backward, job); }
}
