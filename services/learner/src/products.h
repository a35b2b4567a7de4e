// The three products of a layer, without unfolding its patches: outputs, gradient of the inputs,
// gradient of the weights. Each keeps a block of sums in registers; `rows` of it are images or outputs.
#pragma once

#include "extents.h"
#include "geometry.h"
#include "vectors.h"

namespace bpn {
namespace {

// o = sum over a patch of w * x, for kRows images at the same position: convolutions.
template <int Rows>
inline void outputs_at(const Layer& l, const float* patch, const float* transposed, float* o) {
  constexpr int V = kOutputVectors;
  const int stride = l.positions() * l.width;
  for (int first = 0; first < l.width; first += V * kLanes) {
    Floats sums[Rows][V] = {};
    const float* w = transposed + first;
    for (int i = 0; i < l.rows; ++i) {
      const float* x = patch + i * l.row_stride;
      for (int k = 0; k < l.run; ++k, w += l.width)
        each<V>([&](auto v) INLINE_LAMBDA {
          const Floats factor = load(w + v * kLanes);
          each<Rows>([&](auto r) INLINE_LAMBDA { sums[r][v] += factor * x[r * l.image + k]; });
        });
    }
    each<Rows>([&](auto r) INLINE_LAMBDA {
      each<V>([&](auto v) INLINE_LAMBDA { store(o + r * stride + first + v * kLanes, sums[r][v]); });
    });
  }
}

inline void convolve(const Layer& l, int images, const float* x, const float* transposed, float* o) {
  const int stride = l.positions() * l.width;
  for (int b = 0; b < images;) {
    const bool block = images - b >= kRows;
    for (int position = 0; position < l.positions(); ++position) {
      const int at = position / l.size * l.step_y + position % l.size * l.step_x;
      const float* patch = x + b * l.image + at;
      float* to = o + b * stride + position * l.width;
      if (block)
        outputs_at<kRows>(l, patch, transposed, to);
      else
        outputs_at<1>(l, patch, transposed, to);
    }
    b += block ? kRows : 1;
  }
}

inline float sum_of(Floats v) {
  float sum = 0;
  for (int i = 0; i < kLanes; ++i) sum += v[i];
  return sum;
}

// o = sum of w * x as dot products: fully connected layers, whose weights are not worth transposing.
inline void connect(const Layer& l, int images, const float* x, const float* weights, float* o) {
  constexpr int N = 4;  // outputs at a time
  for (int first = 0; first < l.width; first += N)
    for (int b = 0; b < images; b += 2) {
      const int second = b + 1 < images;  // an odd last image is computed twice
      Floats sums[2][N] = {};
      const float *x0 = x + b * l.image, *x1 = x0 + second * l.image;
      for (int k = 0; k < l.run; k += kLanes)
        each<N>([&](auto n) INLINE_LAMBDA {
          const Floats w = load(weights + (first + n) * l.run + k);
          sums[0][n] += w * load(x0 + k);
          sums[1][n] += w * load(x1 + k);
        });
      each<N>([&](auto n) INLINE_LAMBDA {
        o[b * l.width + first + n] = sum_of(sums[0][n]);
        o[(b + second) * l.width + first + n] = sum_of(sums[1][n]);
      });
    }
}

// dx += w * g over all outputs, for Rows images at the same position.
template <int Rows>
inline void input_gradients_at(const Layer& l, const float* g, const float* weights, float* dx) {
  const int g_stride = l.positions() * l.width;
  for (int i = 0; i < l.rows; ++i)
    in_groups(l.run / kLanes, [&]<int V>(int first) {
      const int k = i * l.run + first * kLanes;
      float* to = dx + i * l.row_stride + first * kLanes;
      Floats sums[Rows][V];
      each<Rows>([&](auto r) INLINE_LAMBDA {
        each<V>([&](auto v) INLINE_LAMBDA { sums[r][v] = load(to + r * l.image + v * kLanes); });
      });
      for (int n = 0; n < l.outputs; ++n) {
        Floats w[V];
        each<V>([&](auto v) INLINE_LAMBDA { w[v] = load(weights + n * l.fan_in() + k + v * kLanes); });
        each<Rows>([&](auto r) INLINE_LAMBDA {
          each<V>([&](auto v) INLINE_LAMBDA { sums[r][v] += w[v] * g[r * g_stride + n]; });
        });
      }
      each<Rows>([&](auto r) INLINE_LAMBDA {
        each<V>([&](auto v) INLINE_LAMBDA { store(to + r * l.image + v * kLanes, sums[r][v]); });
      });
    });
}

inline void input_gradients(const Layer& l, int images, const float* g, const float* weights, float* dx) {
  std::memset(dx, 0, sizeof(float) * images * l.image);
  for (int b = 0; b < images;) {
    const bool block = images - b >= kRows;
    for (int position = 0; position < l.positions(); ++position) {
      const int at = position / l.size * l.step_y + position % l.size * l.step_x;
      const float* from = g + (b * l.positions() + position) * l.width;
      float* to = dx + b * l.image + at;
      if (block)
        input_gradients_at<kRows>(l, from, weights, to);
      else
        input_gradients_at<1>(l, from, weights, to);
    }
    b += block ? kRows : 1;
  }
}

// dw += g * x over size_y x size_x positions, x in float or in bytes (conv1: the pixels, and the extents of their
// rows).
template <class Value>
inline void add_weight_gradients(const Layer& l, int size_y, int size_x, int step_x, const Value* x, const float* g,
                                 float* dw, const Extent* extents = nullptr) {
  const int vectors = (l.run + kLanes - 1) / kLanes, run = padded(l.run);
  for (int i = 0; i < l.rows; ++i)
    in_groups(vectors, [&]<int V>(int first) {
      for (int n = 0; n < l.width; n += kRows) {
        Floats sums[kRows][V] = {};
        for (int y = 0; y < size_y; ++y) {
          if (extents && extents[y * l.stride() + i].begin == extents[y * l.stride() + i].end) continue;
          const Value* from = x + y * l.step_y + i * l.row_stride + first * kLanes;
          const float* factors = g + y * size_x * l.width + n;
          for (int position = 0; position < size_x; ++position, from += step_x, factors += l.width) {
            if (are_black<V>(from)) continue;  // nothing is added
            Floats values[V];
            each<V>([&](auto v) INLINE_LAMBDA { values[v] = load(from + v * kLanes); });
            each<kRows>([&](auto r) INLINE_LAMBDA {
              each<V>([&](auto v) INLINE_LAMBDA { sums[r][v] += values[v] * factors[r]; });
            });
          }
        }
        each<kRows>([&](auto r) INLINE_LAMBDA {
          float* to = dw + ((n + r) * l.rows + i) * run + first * kLanes;
          each<V>([&](auto v) INLINE_LAMBDA { store(to + v * kLanes, load(to + v * kLanes) + sums[r][v]); });
        });
      }
    });
}

}  // namespace
}  // namespace bpn
