// From a scene's Gaussians to the table and the lists of tiles that are blended, and back to the
// scene's gradients: preprocess.py, project.py, harmonics.py and tiles.py in one, over threads.
// kernel.py calls it. Every function returns a negative number where it cannot do its work: REFUSED
// where a number is not finite (the caller lets the Python files find it and name it), NO_MEMORY.

#include <algorithm>
#include <atomic>
#include <cmath>

#include "bins.h"
#include "harmonics.h"
#include "job.h"
#include "numbers.h"
#include "project.h"

namespace {

constexpr int64_t REFUSED = -1, NO_MEMORY = -2;
constexpr int64_t LEAST = 1 << 12;  // Gaussians that are worth a thread
constexpr int64_t PART = 64;        // of them that fit into the fastest cache
constexpr int64_t SUMMED = 1 << 10; // whose tiles are summed up, however many threads there are

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

// Whether each of LANES Gaussians, from a row on, may touch the rectangle: its sphere's bound. What
// is not drawn may be kept, what is drawn must be.
template <typename T>
INLINE typename Wide<T>::mask keep_near(
    const Job<T>& job, const View<T>& v, const T* means, const T* scales, const T* logits) {
  using V = typename Wide<T>::of;
  using Mask = typename Wide<T>::mask;
  const Vec<V> sizes = load_rows(scales);
  const V one = V{} + 1, logit = load<V>(logits);
  const Vec<doubles> at = v.in_camera(load_rows(means));
  Mask kept;
  narrow((at.z > job.near) & (at.z <= job.far), kept);
  kept &= logit >= T(job.least_logit);
  V at_x, at_y, depth;
  narrow(at.x, at_x), narrow(at.y, at_y), narrow(at.z, depth);
  const V per_distance = v.orthographic ? one : 1 / most(depth, V{} + T(job.near));
  V extent_of, log_opacity;
  if (job.linear) {
    extent_of = most(most(magnitude(sizes.x), magnitude(sizes.y)), magnitude(sizes.z));
    log_opacity = logarithm(most(logit, V{} + T(job.alpha_min)));
  } else {
    extent_of = exponential(most(most(sizes.x, sizes.y), sizes.z));
    log_opacity = least(logit, V{});  // at least
  }
  const V sigma = extent_of * per_distance;
  const V cutoff = 2 * most(log_opacity - T(job.log_alpha_min), V{});  // squared
  const auto beside = [&](V position, T focal, double low, double high, double shift, T extent)
      __attribute__((always_inline)) {
    const V slope = position * per_distance, inside = held(slope, V{} + T(low), V{} + T(high));
    const V stretch = sigma * focal, place = slope * focal;
    const V variance = stretch * stretch * (1 + inside * inside) + v.blur;
    // float32 rounds a position by 1e-7 of it: much where a sensor is shifted by 1e7 pixels
    const V rounding = 1 + T(1e-6) * least(magnitude(place), V{} + T(1e30));
    const V reach = root(cutoff * variance) * T(1.001) + rounding;
    const V offset = place + T(shift);
    return (offset < -reach) | (offset > extent + reach);
  };
  kept &= ~beside(at_x, v.fx, v.low_x, v.high_x, v.centre_x - job.left, T(job.width));
  kept &= ~beside(at_y, v.fy, v.low_y, v.high_y, v.centre_y - job.top, T(job.height));
  return kept;
}

template <typename T>
int64_t cull(Job<T>& job) {
  Scratch& scratch = *static_cast<Scratch*>(job.scratch);
  int32_t* rows = scratch.rows.at_least(job.count + LANES);
  const View<T> view(job);
  std::vector<int64_t> begins(job.threads, 0), found(job.threads, 0);
  std::atomic<bool> good{true};
  in_parallel(job.threads, job.count, LEAST, PART, [&](int64_t begin, int64_t end, int64_t thread) {
    int64_t kept = begin;
    for (int64_t part = begin; part < end; part += 1024) {  // stays in the cache between the two
      const int64_t last = std::min(end, part + 1024), many = last - part;
      if (!finite(job.means + 3 * part, 3 * many, false, false) ||
          !finite(job.quats + 4 * part, 4 * many, false, false) ||
          !finite(job.log_scales + 3 * part, 3 * many, !job.linear, false) ||
          !finite(job.logits + part, many, !job.linear, !job.linear))
        good = false;
      for (int64_t i = part; i < last; i += LANES) {
        T means[3 * LANES] = {}, scales[3 * LANES] = {}, logits[LANES] = {};
        const bool whole = i + LANES <= last;
        if (!whole) {
          std::copy_n(job.means + 3 * i, 3 * (last - i), means);
          std::copy_n(job.log_scales + 3 * i, 3 * (last - i), scales);
          std::copy_n(job.logits + i, last - i, logits);
        }
        const auto keep = whole ? keep_near(job, view, job.means + 3 * i, job.log_scales + 3 * i,
                                            job.logits + i)
                                : keep_near(job, view, means, scales, logits);
        decltype(keep[0] + 0) flags[LANES];  // -1 or 0
        store(keep, flags);
        for (int64_t row = i; row < std::min(last, i + LANES); row++) {
          rows[kept] = int32_t(row);
          kept -= flags[row - i];
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
  using V = typename Wide<T>::of;
  Vec<V> mean, log_scale;
  V w, x, y, z, logit;
  bool linear;

  INLINE Lanes(const Job<T>& job, int64_t first, int64_t count) {
    T values[11][LANES];
    for (int64_t i = 0; i < LANES; i++) {
      const int64_t row = job.rows[first + std::min(i, count - 1)];
      for (int k = 0; k < 3; k++) values[k][i] = job.means[3 * row + k];
      for (int k = 0; k < 3; k++) values[3 + k][i] = job.log_scales[3 * row + k];
      for (int k = 0; k < 4; k++) values[6 + k][i] = job.quats[4 * row + k];
      values[10][i] = job.logits[row];
    }
    const auto at = [&](int k) __attribute__((always_inline)) { return load<V>(values[k]); };
    mean = {at(0), at(1), at(2)}, log_scale = {at(3), at(4), at(5)};
    w = at(6), x = at(7), y = at(8), z = at(9), logit = at(10), linear = job.linear;
  }
  INLINE V opacity() const { return linear ? logit : 1 / (1 + exponential(-logit)); }
  INLINE V log_opacity() const {
    return linear ? logarithm(most(logit, V{} + std::numeric_limits<T>::min())) : log_sigmoid(logit);
  }
  // Gradient of the logarithm of the opacity by what is stored of it.
  INLINE V by_logit() const { return linear ? 1 / logit : 1 / (1 + exponential(logit)); }
  INLINE Vec<V> scales() const {
    if (linear) return log_scale;
    return {exponential(log_scale.x), exponential(log_scale.y), exponential(log_scale.z)};
  }
};

// Unit vectors from the camera's centre, and what they were divided by: twice, as
// view_directions and harmonics.colors do.
struct Direction {
  Vec<doubles> unit;
  doubles first, second;
};

template <typename T, typename V = typename Wide<T>::of>
INLINE Direction direction(const View<T>& v, Vec<V> mean) {
  const doubles smallest = doubles{} + 1e-12;
  const Vec<doubles> ray = Vec<doubles>{widen(mean.x), widen(mean.y), widen(mean.z)} + v.eye;
  Direction d;
  d.first = most(root(dot(ray, ray)), smallest);
  const Vec<doubles> once = (1 / d.first) * ray;
  d.second = most(root(dot(once, once)), smallest);
  d.unit = (1 / d.second) * once;
  return d;
}

template <typename T, typename V = typename Wide<T>::of>
INLINE Vec<V> narrowed(Vec<doubles> v) {
  Vec<V> to;
  narrow(v.x, to.x), narrow(v.y, to.y), narrow(v.z, to.z);
  return to;
}

template <typename T, int BANDS>
bool colors(const Job<T>& job, const View<T>& v, const Lanes<T>& in, int64_t first, int64_t count) {
  using V = typename Wide<T>::of;
  V basis_of[BANDS];
  Vec<V> unit = in.mean;
  if (BANDS > 1) unit = narrowed<T>(direction(v, in.mean).unit);
  basis<T, BANDS>(unit, basis_of);
  const int64_t columns = job.columns_of_table();
  bool good = true;
  for (int64_t i = 0; i < count; i++) {
    const T* sh = job.sh + int64_t(job.rows[first + i]) * BANDS * 3;
    T color[3] = {T(0), T(0), T(0)}, odd[3] = {T(0), T(0), T(0)};
    for (int c = 0; c < 3; c++) color[c] += basis_of[0][i] * sh[c];
    for (int k = 1; k + 1 < BANDS; k += 2)
      for (int c = 0; c < 3; c++) {
        odd[c] += basis_of[k][i] * sh[3 * k + c];
        color[c] += basis_of[k + 1][i] * sh[3 * k + 3 + c];
      }
    if (BANDS % 2 == 0)
      for (int c = 0; c < 3; c++) odd[c] += basis_of[BANDS - 1][i] * sh[3 * BANDS - 3 + c];
    uint8_t shown = 0;
    for (int c = 0; c < 3; c++) {
      const T value = T(0.5) + (color[c] + odd[c]);
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
    case 0: return true;
    case 1: return colors<T, 1>(job, v, in, first, count);
    case 4: return colors<T, 4>(job, v, in, first, count);
    case 9: return colors<T, 9>(job, v, in, first, count);
    case 16: return colors<T, 16>(job, v, in, first, count);
    default: return colors<T, 25>(job, v, in, first, count);
  }
}

// Tiles of LANES Gaussians' bounding boxes, of each size, summed up.
template <typename T>
struct Taken {
  typename Wide<T>::of of[SIZES] = {};
};

// What LANES Gaussians become on the picture: columns of the table, depths, ellipses, and the
// number of tiles that their bounding boxes take. Whether all of it is finite.
template <typename T>
bool project_lanes(const Job<T>& job, const View<T>& v, const Lanes<T>& in, int64_t first,
                   int64_t count, double* depths, T* shapes, Taken<T>& taken) {
  using V = typename Wide<T>::of;
  const V none = V{};
  const T floor = T(job.log_alpha_min), clip = T(job.radius_clip);
  const Linearised<V> l = linearise(v, in.mean);
  const Ellipse<V> e = ellipse(v.blur, l, rotation<T>(in.w, in.x, in.y, in.z), in.scales());
  V x, y, depth;
  narrow(v.focal_x * l.slope_x + v.centre_x, x), narrow(v.focal_y * l.slope_y + v.centre_y, y);
  narrow(l.z, depth);
  x -= v.left, y -= v.top;
  const V within = e.conditional * (e.xx / e.yy);
  const V zero = (x + y + e.xx + e.xy + e.yy + within + e.root + e.w1 + e.w2) * 0;
  V log_opacity = in.log_opacity();
  if (job.antialiased) log_opacity += log_compensation<T>(e);
  const V wide = root(e.xx), high = root(e.yy);
  V radius = root(most(2 * (log_opacity - floor), none));
  auto hidden = in.opacity() < T(job.alpha_min);
  if (clip > 0) hidden |= rounded_up(radius * most(wide, high)) <= clip;
  log_opacity = hidden ? none + 2 * floor : log_opacity;
  hidden |= log_opacity < floor - T(1e-3);
  radius = hidden ? none : radius;

  const auto span = [&](V at, V half, T extent) __attribute__((always_inline)) {
    const V end = none + extent;
    return most(held(at + half, none, end) - held(at - half, none, end), none);
  };
  V across = span(x, radius * wide, T(job.width)), down = span(y, radius * high, T(job.height));
  const V counted = hidden ? none : none + 1;
  for (int s = 0; s < SIZES; s++) {
    const T per = T(1) / TILE_SIZES[s];
    taken.of[s] += (across * per + 1) * (down * per + 1) * counted;
  }
  T out[GEOMETRY + 1][LANES], shape[FOOTPRINT][LANES], bad[LANES];
  store(x, out[0]), store(y, out[1]), store(e.root, out[2]), store(e.w1, out[3]);
  store(e.w2, out[4]), store(log_opacity, out[5]), store(depth, out[6]), store(zero, bad);
  footprint(x, y, e.xx, e.xy, e.yy, within, radius, hidden, shape);
  const int64_t columns = job.columns_of_table();
  bool good = true;
  for (int64_t i = 0; i < count; i++) {
    T* row = job.table + (first + i) * columns;
    for (int k = 0; k < GEOMETRY; k++) row[k] = out[k][i];
    for (int k = 0; k < FOOTPRINT; k++) shapes[(first + i) * FOOTPRINT + k] = shape[k][i];
    if (job.with_depth) row[job.depth_column()] = out[GEOMETRY][i];
    if (job.depths) job.depths[first + i] = out[GEOMETRY][i];
    for (int k = 0; job.centers && k < 2; k++)
      job.centers[2 * int64_t(job.rows[first + i]) + k] = out[k][i];
    depths[first + i] = l.z[i];
    good &= bad[i] == 0;
  }
  return good;
}

template <typename T>
int64_t choose_tile_size(const Job<T>& job, const std::vector<double>& tiles) {
  double cheapest = std::numeric_limits<double>::infinity();
  int64_t chosen = TILE_SIZES[0];
  for (int s = 0; s < SIZES; s++) {
    double sum = 0;
    for (size_t at = s; at < tiles.size(); at += SIZES) sum += tiles[at];
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
  std::vector<double> tiles((job.drawn / SUMMED + 1) * SIZES, 0.0);
  std::atomic<bool> good{true};
  in_parallel(job.threads, job.drawn, SUMMED, SUMMED, [&](int64_t begin, int64_t last, int64_t) {
    for (int64_t part = begin; part < last; part += SUMMED) {
      const int64_t end = std::min(last, part + SUMMED);
      Taken<T> taken;
      for (int64_t i = part; i < end; i += LANES) {
        const int64_t count = std::min<int64_t>(LANES, end - i);
        const Lanes<T> lanes(job, i, count);
        if (!project_lanes(job, view, lanes, i, count, depths, shapes, taken) ||
            !colors_of(job, view, lanes, i, count))
          good = false;
      }
      for (int s = 0; s < SIZES; s++)
        for (int i = 0; i < LANES; i++) tiles[part / SUMMED * SIZES + s] += taken.of[s][i];
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
  in_parallel(job.threads, job.drawn, LEAST / 4, PART, [&](int64_t begin, int64_t end, int64_t thread) {
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
      depth_order(scratch, job.threads, scratch.depths.data(), first_span, job.drawn, visible);
  // each thread fills the lists of its rows of tiles, which hold about as many pairs
  std::vector<int64_t> bands = {0};
  const int64_t threads = std::max<int64_t>(1, std::min(job.threads, job.pairs / LEAST));
  for (int64_t row = 1; row < job.tile_rows && int64_t(bands.size()) < threads; row++)
    if (job.starts[row * job.columns] >= job.pairs * int64_t(bands.size()) / threads)
      bands.push_back(row * job.columns);
  bands.push_back(tiles);
  const int64_t parts = int64_t(bands.size()) - 1;  // at most so many as there are threads
  in_parallel(job.threads, parts, 1, 1, [&](int64_t first, int64_t last, int64_t) {
    if (first == last) return;
    const int64_t low = bands[first], high = bands[last];
    for (int64_t rank = 0; rank < visible; rank++) {
      // in the order of depths, every Gaussian is somewhere else in memory
      const int64_t soon = uint32_t(order[std::min(rank + 8, visible - 1)]);
      const int64_t later = uint32_t(order[std::min(rank + 16, visible - 1)]);
      __builtin_prefetch(spans + first_span[soon]);
      __builtin_prefetch(first_span + later), __builtin_prefetch(job.firsts + later);
      const int64_t i = uint32_t(order[rank]);
      int64_t slot = job.firsts[i];
      for (int64_t s = first_span[i]; s < first_span[i + 1]; s++) {
        const int64_t tile = spans[s].tile, count = spans[s].count;
        if (tile >= high) break;
        if (tile >= low)
          for (int64_t k = 0; k < count; k++) {
            const int64_t at = counts[tile + k]++;
            job.members[at] = i, job.slots[at] = slot + k;
          }
        slot += count;
      }
    }
  });
  return 0;
}

// LANES Gaussians' rows of the table's gradient: sums over their pairs.
template <typename T>
struct Upstream {
  T of[GEOMETRY + 4][LANES] = {};

  template <int COLUMNS>
  INLINE void sum(const Job<T>& job, int64_t first, int64_t count) {
    for (int64_t i = first; i < first + count; i++) {
      const int64_t end = i + 1 < job.drawn ? job.firsts[i + 1] : job.pairs;
      typename Wide<T>::of sum = {};
      constexpr int WHOLE = COLUMNS < LANES ? 0 : LANES;  // one load
      T more[COLUMNS - WHOLE] = {};
      for (int64_t p = job.firsts[i]; p < end; p++) {
        const T* row = job.pair_gradients + p * COLUMNS;
        if (WHOLE) sum += load<typename Wide<T>::of>(row);
        for (int k = WHOLE; k < COLUMNS; k++) more[k - WHOLE] += row[k];
      }
      for (int k = 0; k < COLUMNS; k++)
        of[k][i - first] = k < WHOLE ? sum[k] : more[k - WHOLE];
      for (int c = 0; job.bands && c < 3; c++)
        if (!(job.shown[i] >> c & 1)) of[GEOMETRY + c][i - first] = T(0);
      for (int k = 0; job.grad_centers && k < 2; k++)
        of[k][i - first] = job.grad_centers[2 * int64_t(job.rows[i]) + k];
    }
  }
  Upstream(const Job<T>& job, int64_t first, int64_t count) {
    switch (job.columns_of_table()) {
      case GEOMETRY: sum<GEOMETRY>(job, first, count); break;
      case GEOMETRY + 1: sum<GEOMETRY + 1>(job, first, count); break;
      case GEOMETRY + 3: sum<GEOMETRY + 3>(job, first, count); break;
      default: sum<GEOMETRY + 4>(job, first, count);
    }
  }
  INLINE typename Wide<T>::of operator[](int k) const {
    return load<typename Wide<T>::of>(of[k]);
  }
};

// Gradients of the harmonics; and of the centres in the world, by the directions.
template <typename T, int BANDS>
Vec<doubles> color_gradients(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                             const Upstream<T>& up, int64_t first, int64_t count) {
  using V = typename Wide<T>::of;
  const V red = up[GEOMETRY], green = up[GEOMETRY + 1], blue = up[GEOMETRY + 2];
  Direction d;
  Vec<V> unit = in.mean;
  if (BANDS > 1) {
    d = direction(v, in.mean);
    unit = narrowed<T>(d.unit);
  }
  V by_basis[BANDS];
  if (job.grad_sh) {
    basis<T, BANDS>(unit, by_basis);
    for (int64_t i = 0; i < count; i++) {
      T* out = job.grad_sh + int64_t(job.rows[first + i]) * BANDS * 3;
      const T g[3] = {red[i], green[i], blue[i]};
      for (int k = 0; k < BANDS; k++)
        for (int c = 0; c < 3; c++) out[3 * k + c] = by_basis[k][i] * g[c];
    }
  }
  if (BANDS == 1 || !job.grad_means) return {doubles{}, doubles{}, doubles{}};
  T sums[BANDS][LANES] = {};
  for (int64_t i = 0; i < count; i++) {
    const T* sh = job.sh + int64_t(job.rows[first + i]) * BANDS * 3;
    const T r = red[i], g = green[i], b = blue[i];
    for (int k = 1; k < BANDS; k++)
      sums[k][i] = sh[3 * k] * r + sh[3 * k + 1] * g + sh[3 * k + 2] * b;
  }
  for (int k = 0; k < BANDS; k++) by_basis[k] = load<V>(sums[k]);
  const Vec<V> g = basis_gradient<T, BANDS>(unit, by_basis);
  Vec<doubles> by = {widen(g.x), widen(g.y), widen(g.z)};
  by = (1 / d.second) * (by - (d.second > 1e-12 ? dot(by, d.unit) : doubles{}) * d.unit);
  return (1 / d.first) * (by - (d.first > 1e-12 ? dot(by, d.unit) : doubles{}) * d.unit);
}

template <typename T>
Vec<doubles> color_gradients_of(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                                const Upstream<T>& up, int64_t first, int64_t count) {
  switch (job.bands) {
    case 0: return {doubles{}, doubles{}, doubles{}};
    case 1: return color_gradients<T, 1>(job, v, in, up, first, count);
    case 4: return color_gradients<T, 4>(job, v, in, up, first, count);
    case 9: return color_gradients<T, 9>(job, v, in, up, first, count);
    case 16: return color_gradients<T, 16>(job, v, in, up, first, count);
    default: return color_gradients<T, 25>(job, v, in, up, first, count);
  }
}

// Gradients of centres, rotations, scales and opacities; `mean` is the directions' part.
template <typename T>
void geometry_gradients(const Job<T>& job, const View<T>& v, const Lanes<T>& in,
                        const Upstream<T>& up, int64_t first, int64_t count, Vec<doubles> mean) {
  using V = typename Wide<T>::of;
  const Linearised<V> l = linearise(v, in.mean);
  const Rotation<V> q = rotation<T>(in.w, in.x, in.y, in.z);
  const Vec<V> scales = in.scales();
  const Ellipse<V> e = ellipse(v.blur, l, q, scales);
  const V by_opacity = up[5];
  const GeometryGradient<V> g = geometry_gradient<T>(
      v, l, q, scales, e, up[0], up[1], up[2], up[3], up[4],
      job.antialiased ? by_opacity : V{}, up[int(job.depth_column())], job.linear);
  const Vec<V> centre = narrowed<T>(mean + v.in_world(g.mean));
  T out[11][LANES];
  store(centre.x, out[0]), store(centre.y, out[1]), store(centre.z, out[2]);
  store(g.scales.x, out[3]), store(g.scales.y, out[4]), store(g.scales.z, out[5]);
  store(g.w, out[6]), store(g.x, out[7]), store(g.y, out[8]), store(g.z, out[9]);
  store(by_opacity * in.by_logit(), out[10]);
  for (int64_t i = 0; i < count; i++) {
    const int64_t row = job.rows[first + i];
    if (job.grad_means)
      for (int k = 0; k < 3; k++) job.grad_means[3 * row + k] = out[k][i];
    if (job.grad_log_scales)
      for (int k = 0; k < 3; k++) job.grad_log_scales[3 * row + k] = out[3 + k][i];
    if (job.grad_quats)
      for (int k = 0; k < 4; k++) job.grad_quats[4 * row + k] = out[6 + k][i];
    if (job.grad_logits) job.grad_logits[row] = out[10][i];
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

// Gradients of opacities alone, as an edit of colours asks for them.
template <typename T>
void opacity_gradients(const Job<T>& job, const Lanes<T>& in, const Upstream<T>& up, int64_t first,
                       int64_t count) {
  T out[LANES];
  store(up[5] * in.by_logit(), out);
  for (int64_t i = 0; i < count; i++) job.grad_logits[job.rows[first + i]] = out[i];
}

template <typename T>
int64_t backward(Job<T>& job) {
  const View<T> view(job);
  const bool geometry = job.grad_means || job.grad_quats || job.grad_log_scales;
  if (!job.drawn) clear(job, 0, job.count);
  in_parallel(job.threads, job.drawn, LEAST / 4, PART, [&](int64_t begin, int64_t end, int64_t) {
    for (int64_t i = begin; i < end; i += LANES) {
      const int64_t count = std::min<int64_t>(LANES, end - i);
      // few calls, and what they clear is in the cache when its rows are written
      if ((i - begin) % PART == 0)
        clear(job, i ? job.rows[i] : 0, i + PART < job.drawn ? job.rows[i + PART] : job.count);
      const Lanes<T> lanes(job, i, count);
      const Upstream<T> upstream(job, i, count);
      const Vec<doubles> mean = color_gradients_of(job, view, lanes, upstream, i, count);
      if (geometry) geometry_gradients(job, view, lanes, upstream, i, count, mean);
      else if (job.grad_logits) opacity_gradients(job, lanes, upstream, i, count);
    }
  });
  return 0;
}

// Fills grad_table, each row the sum of a Gaussian's pairs', and grad_centers where they are drawn.
template <typename T, int COLUMNS>
int64_t sum(const Job<T>& job) {
  const int64_t columns = COLUMNS ? COLUMNS : job.grad_columns;
  in_parallel(job.threads, job.drawn, LEAST / 4, PART, [&](int64_t begin, int64_t end, int64_t) {
    std::vector<T> sums(columns);
    for (int64_t i = begin; i < end; i++) {
      T few[COLUMNS + 1];
      T* const total = COLUMNS ? few : sums.data();
      std::fill_n(total, columns, T(0));
      const int64_t last = i + 1 < job.drawn ? job.firsts[i + 1] : job.pairs;
      for (int64_t p = job.firsts[i]; p < last; p++)
        for (int64_t k = 0; k < columns; k++) total[k] += job.pair_gradients[p * columns + k];
      std::copy_n(total, columns, job.grad_table + i * columns);
      std::copy_n(total, 2, job.grad_centers + 2 * int64_t(job.rows[i]));
    }
  });
  return 0;
}

template <typename T>
int64_t sum(Job<T>& job) {
  return job.grad_columns == GEOMETRY + 3 ? sum<T, GEOMETRY + 3>(job) : sum<T, 0>(job);
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
int64_t sum_float32(Job<float>* job) { return guarded(sum<float>, job); }
int64_t sum_float64(Job<double>* job) { return guarded(sum<double>, job); }
int64_t backward_float32(Job<float>* job) { return guarded(backward, job); }
int64_t backward_float64(Job<double>* job) { return guarded(backward, job); }
}
