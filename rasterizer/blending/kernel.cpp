// Blending, forward and backward: see composite.py for the equations and cpp_backend.py for the
// caller. Threads take tiles from a counter; each works in buffers that stay in its cache.
//
// A tile is cut into cells of CELL * CELL pixels, a cell into blocks of as many pixels as a vector
// has lanes. Of each Gaussian in the tile's list only those blocks are visited that its ellipse
// reaches, and of those the open ones: a block is closed once at most a share of `stop` passes its
// pixels.
//
// The backward pass goes from the last Gaussian to the first and divides what is left of the
// transmittance by what each lets through. So that this is possible, a pixel is finished where its
// transmittance is FINISHED: what lies behind is not blended, and `ends` says where that was.

#include <atomic>
#include <vector>

#include "chunk.h"
#include "threads.h"

namespace {

// Of the stop, which is meant for tiles: most pixels of those let less than it through when the last
// one does. Those of a block, a tenth as many, let more through: closed at the whole stop, gradients
// of opacities were wrong by 4.5e-4 on opaque discs (here by 8e-5, tiles 1.9e-4), for 2.5 % less time.
constexpr double CLOSED = 0.2;

template <typename T>
constexpr T FINISHED = T(sizeof(T) == 4 ? 1e-20 : 1e-200);

// The exponents of two, of the floor and of the cap, that bound alpha; the least weight that gets a
// gradient.
template <typename T>
struct Bounds {
  V<T> low, high, least;

  explicit Bounds(const Job<T>& job) {
    // what lets nothing through cannot be divided by
    const double most = std::log1p(-16.0 * std::numeric_limits<T>::epsilon());
    const double normal = std::numeric_limits<T>::min_exponent + 2;  // where exp2 is a normal number
    low = V<T>{} + T(std::max(job.log_alpha_min * 1.4426950408889634, normal));
    high = V<T>{} + T(std::min(job.log_alpha_max, most) * 1.4426950408889634);
    least = V<T>{} + T(job.least);
  }
};

// What a thread works in.
template <typename T>
struct Buffers {
  using S = Shape<T>;
  struct alignas(64) Plane {
    T at[S::PIXELS];
  };
  Plane x, y, transmittance, finished, behind;
  I<T> end[S::BLOCKS], index[S::BLOCKS];
  Chunk<T> chunk;
  std::vector<Plane> features;  // or the loss's gradients by them
  std::vector<V<T>> sums;       // over pixels, of a chunk's gradients, column by column
  std::vector<T> totals;        // the same, over lanes too

  explicit Buffers(const Job<T>& job)
      : features(job.depth), sums((GEOMETRY + job.depth) * CHUNK),
        totals((GEOMETRY + job.depth) * CHUNK) {
    for (int j = 0; j < S::CELL; j++)
      for (int i = 0; i < S::CELL; i++) {
        x.at[S::place(i, j)] = T(i) + T(0.5) - S::CELL / 2;
        y.at[S::place(i, j)] = T(j) + T(0.5) - S::CELL / 2;
      }
  }
};

// Let light through the pixels that are wanted, none off the picture; the blocks that have any.
template <typename T>
Mask open_blocks(const Job<T>& job, const Cell<T>& cell, Buffers<T>& b) {
  Mask open = 0;
  cell.each_pixel([&](int p, int64_t at) {
    if (job.wanted && job.wanted[at] == 0) return;
    b.transmittance.at[p] = 1, open |= Mask(1) << p / LANES<T>;
  });
  return open;
}

// Gaussians after which a transmittance above FINISHED is still a normal number.
template <typename T>
int safe_count(const Job<T>& job) {
  const double most = std::log(double(FINISHED<T>) / std::numeric_limits<T>::min());
  return int(std::min<double>(CHUNK, 1 + most / -std::log1p(-std::exp(job.log_alpha_max))));
}

// Close the blocks that are opaque, and finish pixels, after `place` Gaussians of the list.
template <typename T>
void close_blocks(Buffers<T>& b, T stop, int32_t place, Mask& open) {
  const T closed = std::max(stop, FINISHED<T>);
  const V<T> none = {};
  for (Mask todo = open; todo; todo &= todo - 1) {
    const int k = lowest(todo), p = k * LANES<T>;
    const V<T> t = load<T>(b.transmittance.at + p);
    if (!any((t <= closed) & (t > 0))) continue;
    const I<T> finished = (t <= FINISHED<T>) & (t > 0);
    if (any(finished)) {
      store<T>(b.finished.at + p, finished ? t : load<T>(b.finished.at + p));
      store<T>(b.transmittance.at + p, finished ? none : t);
      b.end[k] = finished ? I<T>{} + place : b.end[k];
    }
    if (!any(t > closed)) {
      b.end[k] = b.end[k] < place ? b.end[k] : I<T>{} + place;
      open &= ~(Mask(1) << k);
    }
  }
}

// DEPTH: the number of features where it is known, else 0.
template <typename T, int DEPTH, bool MEDIAN>
void forward(const Job<T>& job, const Cell<T>& cell, Buffers<T>& b) {
  using S = Shape<T>;
  constexpr int W = LANES<T>;
  const int64_t depth = DEPTH ? DEPTH : job.depth;
  const Bounds<T> bounds(job);
  auto* const features = b.features.data();
  for (auto* plane : {&b.transmittance, &b.finished}) std::fill_n(plane->at, S::PIXELS, T(0));
  for (int64_t f = 0; f < depth; f++) std::fill_n(features[f].at, S::PIXELS, T(0));
  for (int k = 0; k < S::BLOCKS; k++) b.end[k] = I<T>{} + INT32_MAX, b.index[k] = I<T>{} - 1;

  const int period = safe_count(job);
  const T stop = T(CLOSED * job.stop);
  Mask open = open_blocks(job, cell, b);
  int64_t place = 0;
  Chunk<T>& chunk = b.chunk;
  for (int64_t start = 0; start < cell.count && open; start += CHUNK) {
    chunk.fill(cell, start, start + CHUNK);
    for (int g = 0; g < std::min<int64_t>(CHUNK, cell.count - start); g++) {
      const T w0 = chunk.w0[g], w1 = chunk.w1[g], w2 = chunk.w2[g];
      const T u0 = chunk.u0[g], v0 = chunk.v0[g], c = chunk.c[g];
      const T* feature = chunk.features[g];
      for (Mask todo = chunk.blocks[g] & open; todo; todo &= todo - 1) {
        const int k = lowest(todo), p = k * W;
        const V<T> x = load<T>(b.x.at + p), y = load<T>(b.y.at + p);
        const V<T> u = w0 * x + u0, v = w1 * x + (w2 * y + v0), e = (c - u * u) - v * v;
        const V<T> value = exp2<T>(e < bounds.high ? e : bounds.high);
        const V<T> alpha = e >= bounds.low ? value : V<T>{};
        const V<T> before = load<T>(b.transmittance.at + p), weight = alpha * before;
        const V<T> after = before - weight;
        store<T>(b.transmittance.at + p, after);
        for (int64_t f = 0; f < depth; f++)
          store<T>(features[f].at + p, load<T>(features[f].at + p) + feature[f] * weight);
        if (MEDIAN) {
          const I<T> falls = (before > T(0.5)) & (after <= T(0.5));
          b.index[k] = falls ? I<T>{} + int32_t(place) : b.index[k];
        }
      }
      if (++place % period == 0) close_blocks(b, stop, int32_t(place), open);
    }
  }
  close_blocks(b, stop, int32_t(place), open);
  cell.each_pixel([&](int p, int64_t at) {
    job.transmittance[at] = b.transmittance.at[p] + b.finished.at[p];
    for (int64_t f = 0; f < depth; f++) job.features[at * depth + f] = features[f].at[p];
    if (job.ends) job.ends[at] = int32_t(std::min<int64_t>(b.end[p / W][p % W], place));
    if (MEDIAN) {
      const int64_t i = b.index[p / W][p % W];
      job.median_index[at] = i < 0 ? -1 : job.members[cell.first + i];
    }
  });
}

// The sums over pixels of maps times each pair's weight, of which `forward` makes the picture: the
// same pixels in the same order. Writes the tile's pairs, or adds where another cell of it wrote.
template <typename T, int DEPTH>
void pull(const Job<T>& job, const Cell<T>& cell, Buffers<T>& b, bool is_first) {
  using S = Shape<T>;
  constexpr int W = LANES<T>;
  const Bounds<T> bounds(job);
  const auto* const maps = b.features.data();
  for (auto* plane : {&b.transmittance, &b.finished}) std::fill_n(plane->at, S::PIXELS, T(0));
  for (auto& plane : b.features) std::fill_n(plane.at, S::PIXELS, T(0));
  for (int k = 0; k < S::BLOCKS; k++) b.end[k] = I<T>{} + INT32_MAX;
  cell.each_pixel([&](int p, int64_t at) {
    for (int64_t f = 0; f < DEPTH; f++) b.features[f].at[p] = job.grad_features[at * DEPTH + f];
  });

  const auto gradient = [&](int64_t i) { return job.gradients + job.slots[cell.first + i] * DEPTH; };
  const int period = safe_count(job);
  const T stop = T(CLOSED * job.stop);
  Mask open = open_blocks(job, cell, b);
  int64_t start = 0;
  Chunk<T>& chunk = b.chunk;
  T* const totals = b.totals.data();
  for (; start < cell.count && open; start += CHUNK) {
    const int64_t end = std::min<int64_t>(start + CHUNK, cell.count);
    chunk.fill(cell, start, start + CHUNK);
    for (int64_t i = start; i < end; i++) __builtin_prefetch(gradient(i), 1);
    for (int g = 0; g < end - start; g++) {
      const T w0 = chunk.w0[g], w1 = chunk.w1[g], w2 = chunk.w2[g];
      const T u0 = chunk.u0[g], v0 = chunk.v0[g], c = chunk.c[g];
      V<T> sums[DEPTH] = {};
      for (Mask todo = chunk.blocks[g] & open; todo; todo &= todo - 1) {
        const int p = lowest(todo) * W;
        const V<T> x = load<T>(b.x.at + p), y = load<T>(b.y.at + p);
        const V<T> u = w0 * x + u0, v = w1 * x + (w2 * y + v0), e = (c - u * u) - v * v;
        const V<T> value = exp2<T>(e < bounds.high ? e : bounds.high);
        const V<T> alpha = e >= bounds.low ? value : V<T>{};
        const V<T> before = load<T>(b.transmittance.at + p), weight = alpha * before;
        store<T>(b.transmittance.at + p, before - weight);
        for (int64_t f = 0; f < DEPTH; f++) sums[f] = sums[f] + weight * load<T>(maps[f].at + p);
      }
      for (int f = 0; f < DEPTH; f++) b.sums[f * CHUNK + g] = sums[f];
      const int64_t place = start + g + 1;
      if (place % period == 0) close_blocks(b, stop, int32_t(place), open);
    }
    for (int64_t j = 0; j < DEPTH * CHUNK; j += W)
      store<T>(totals + j, sums_of_lanes<T>(b.sums.data() + j));
    for (int64_t i = start; i < end; i++)
      for (int f = 0; f < DEPTH; f++) {
        const T total = totals[f * CHUNK + (i - start)];
        T& out = gradient(i)[f];
        out = is_first ? total : out + total;
      }
  }
  for (int64_t i = start; is_first && i < cell.count; i++) std::fill_n(gradient(i), DEPTH, T(0));
}

// From the sums of g, g u, g v, g u x, g v x, g v y (g: the gradient by the exponent) to the
// gradients by x, y, w0, w1, w2, log opacity; of a chunk, column by column.
template <typename T>
inline void chain(const Chunk<T>& chunk, T* sums) {
  constexpr T scale = 1 / Chunk<T>::SCALE;
#pragma omp simd
  for (int g = 0; g < CHUNK; g++) {
    T* at = sums + g;
    const T w0 = scale * chunk.w0[g], w1 = scale * chunk.w1[g], w2 = scale * chunk.w2[g];
    const T s = at[0], u = scale * at[CHUNK], v = scale * at[2 * CHUNK];
    at[0] = w0 * u + w1 * v;
    at[CHUNK] = w2 * v;
    at[2 * CHUNK] = -(scale * at[3 * CHUNK] + chunk.dx[g] * u);
    at[3 * CHUNK] = -(scale * at[4 * CHUNK] + chunk.dx[g] * v);
    at[4 * CHUNK] = -(scale * at[5 * CHUNK] + chunk.dy[g] * v);
    at[5 * CHUNK] = s;
  }
}

// One Gaussian of the chunk: sums over the blocks, a column every CHUNK vectors of `kept`.
template <typename T, int DEPTH>
inline void blend_back(Buffers<T>& b, const Bounds<T>& bounds, int g, int32_t place, Mask blocks,
                       int64_t depth, V<T>* kept) {
  const Chunk<T>& chunk = b.chunk;
  const auto* const upstream = b.features.data();
  const T w0 = chunk.w0[g], w1 = chunk.w1[g], w2 = chunk.w2[g];
  const T u0 = chunk.u0[g], v0 = chunk.v0[g], c = chunk.c[g];
  const T* feature = chunk.features[g];
  V<T> sums[GEOMETRY + DEPTH] = {};
  for (int64_t column = 0; column < GEOMETRY + depth; column++) kept[column * CHUNK] = V<T>{};
  for (Mask todo = blocks; todo; todo &= todo - 1) {
    const int k = lowest(todo), p = k * LANES<T>;
    const V<T> x = load<T>(b.x.at + p), y = load<T>(b.y.at + p);
    const V<T> u = w0 * x + u0, v = w1 * x + (w2 * y + v0), e = (c - u * u) - v * v;
    const V<T> value = exp2<T>(e < bounds.high ? e : bounds.high);
    const V<T> alpha = ((e >= bounds.low) & (b.end[k] > place)) ? value : V<T>{};
    const V<T> inverse = T(1) / (T(1) - alpha);
    const V<T> in_front = load<T>(b.transmittance.at + p) * inverse, weight = alpha * in_front;
    const V<T> felt = weight < bounds.least ? V<T>{} : weight;
    V<T> gain = {};
    for (int64_t f = 0; f < depth; f++) {
      const V<T> up = load<T>(upstream[f].at + p);
      gain = gain + feature[f] * up;
      V<T>& sum = DEPTH ? sums[GEOMETRY + f] : kept[(GEOMETRY + f) * CHUNK];
      sum = sum + felt * up;
    }
    const V<T> behind = load<T>(b.behind.at + p);
    // no gradient where alpha is held at its cap, or carries too little
    const V<T> slope = ((e > bounds.high) | (weight < bounds.least)) ? V<T>{} : alpha;
    const V<T> grad = (gain * in_front - behind * inverse) * slope;
    store<T>(b.transmittance.at + p, in_front);
    store<T>(b.behind.at + p, behind + gain * weight);
    const V<T> gu = grad * u, gv = grad * v;
    sums[0] = sums[0] + grad, sums[1] = sums[1] + gu, sums[2] = sums[2] + gv;
    sums[3] = sums[3] + gu * x, sums[4] = sums[4] + gv * x, sums[5] = sums[5] + gv * y;
  }
  for (int column = 0; column < GEOMETRY + DEPTH; column++) kept[column * CHUNK] = sums[column];
}

// Writes the gradients of the tile's pairs, or adds to them where another cell of the tile wrote.
template <typename T, int DEPTH>
void backward(const Job<T>& job, const Cell<T>& cell, Buffers<T>& b, bool is_first) {
  using S = Shape<T>;
  constexpr int W = LANES<T>;
  const int64_t depth = DEPTH ? DEPTH : job.depth, columns = GEOMETRY + depth;
  const Bounds<T> bounds(job);
  for (auto* plane : {&b.transmittance, &b.behind}) std::fill_n(plane->at, S::PIXELS, T(0));
  for (auto& plane : b.features) std::fill_n(plane.at, S::PIXELS, T(0));
  std::fill_n(b.end, S::BLOCKS, I<T>{});
  int32_t last[S::BLOCKS] = {}, visited = 0;  // places at which the blocks, and the cell, end
  cell.each_pixel([&](int p, int64_t at) {
    b.transmittance.at[p] = job.transmittance[at];
    b.behind.at[p] = job.grad_transmittance[at] * job.transmittance[at];
    for (int64_t f = 0; f < depth; f++)
      b.features[f].at[p] = job.grad_features[at * depth + f];
    b.end[p / W][p % W] = job.ends[at];
    last[p / W] = std::max(last[p / W], job.ends[at]);
    visited = std::max(visited, job.ends[at]);
  });

  const auto gradient = [&](int64_t i) {
    return job.gradients + job.slots[cell.first + i] * columns;
  };
  for (int64_t i = visited; is_first && i < cell.count; i++)
    std::fill_n(gradient(i), columns, T(0));
  Chunk<T>& chunk = b.chunk;
  T* const totals = b.totals.data();
  for (int64_t end = visited; end > 0;) {
    const int64_t start = (end - 1) / CHUNK * CHUNK;
    chunk.fill(cell, start, start - CHUNK);
    for (int64_t i = start; i < end; i++)  // written below; without this, that is a fifth of the time
      __builtin_prefetch(gradient(i), 1), __builtin_prefetch(gradient(i) + columns - 1, 1);
    Mask open = 0;
    for (int k = 0; k < S::BLOCKS; k++) open |= Mask(last[k] > start) << k;
    for (int64_t i = end - 1; i >= start; i--) {
      const int g = int(i - start);
      const Mask blocks = chunk.blocks[g] & open;
      blend_back<T, DEPTH>(b, bounds, g, int32_t(i), blocks, depth, b.sums.data() + g);
    }
    for (int64_t j = 0; j < columns * CHUNK; j += W)
      store<T>(totals + j, sums_of_lanes<T>(b.sums.data() + j));
    chain(chunk, totals);
    for (int64_t i = start; i < end; i++) {
      T* out = gradient(i);
      for (int64_t column = 0; column < columns; column++) {
        const T total = totals[column * CHUNK + (i - start)];
        out[column] = is_first ? total : out[column] + total;
      }
    }
    end = start;
  }
}

// 0, or 1 where there was no memory. Threads take tiles from a counter.
template <typename T, typename Work>
int each_cell(const Job<T>& job, Work work) {
  std::atomic<int64_t> next{0};
  const int64_t tiles = job.columns * job.rows;
  return !over_threads(job.threads, std::min(job.threads, tiles), [&](int64_t) {
    Buffers<T> buffers(job);
    for (int64_t t; (t = next.fetch_add(1)) < tiles;) {
      const int64_t left = t % job.columns * job.side, top = t / job.columns * job.side;
      const int64_t right = std::min(left + job.side, job.width);
      const int64_t bottom = std::min(top + job.side, job.height);
      for (int64_t y = top; y < bottom; y += Shape<T>::CELL)
        for (int64_t x = left; x < right; x += Shape<T>::CELL)
          work(Cell<T>(job, t, x, y, right, bottom), buffers, x == left && y == top);
    }
  });
}

template <typename T, int DEPTH>
int run(const Job<T>& job, bool back) {
  return each_cell(job, [&](const Cell<T>& cell, Buffers<T>& buffers, bool is_first) {
    if (back) backward<T, DEPTH>(job, cell, buffers, is_first);
    else if (job.median_index) forward<T, DEPTH, true>(job, cell, buffers);
    else forward<T, DEPTH, false>(job, cell, buffers);
  });
}

template <typename T>
int run_pull(const Job<T>& job) {
  return each_cell(job, [&](const Cell<T>& cell, Buffers<T>& buffers, bool is_first) {
    pull<T, 3>(job, cell, buffers, is_first);
  });
}

template <typename T>
int run(const Job<T>& job, bool back) {
  return job.depth == 3 ? run<T, 3>(job, back) : run<T, 0>(job, back);
}

}  // namespace

extern "C" {
int forward_float32(const Job<float>* job) { return run(*job, false); }
int forward_float64(const Job<double>* job) { return run(*job, false); }
int backward_float32(const Job<float>* job) { return run(*job, true); }
int backward_float64(const Job<double>* job) { return run(*job, true); }
int pull_float32(const Job<float>* job) { return run_pull(*job); }
int pull_float64(const Job<double>* job) { return run_pull(*job); }
}
