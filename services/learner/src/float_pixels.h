// conv1's outputs in floating point: as many inputs at a time as fit a vector beside eight outputs.
#pragma once

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include "geometry.h"
#include "vectors.h"

namespace bpn {
namespace {

constexpr int kTogether = kLanes > kConv1Outputs ? kLanes / kConv1Outputs : 1;     // inputs in a vector
constexpr int kConv1Vectors = kLanes < kConv1Outputs ? kConv1Outputs / kLanes : 1;  // of the outputs
constexpr int kFloatColumns = kConv1Vectors > 1 ? 4 : 10;                           // divides conv1's 20

// kTogether neighbouring inputs, again and again.
inline Floats repeated(const float* inputs) {
#if defined(__AVX512F__)
  static_assert(kTogether == 2);
  return (Floats)_mm512_set1_epi64(loaded<int64_t>(inputs));
#else
  static_assert(kTogether == 1);
  return Floats{} + *inputs;
#endif
}

inline void convolve_floats(const Layer& l, const float* image, const float* pixel_weights, float* o) {
  for (int y = 0; y < l.size; ++y)
    for (int x = 0; x < l.size; x += kFloatColumns) {
      Floats sums[kFloatColumns][kConv1Vectors] = {};
      const float* patch = image + y * l.step_y + x * l.step_x;
      const float* w = pixel_weights;
      for (int i = 0; i < l.rows; ++i)
        for (int k = 0; k < l.run; k += kTogether, w += kConv1Vectors * kLanes)
          each<kFloatColumns>([&](auto c) INLINE_LAMBDA {
            const Floats inputs = repeated(patch + i * l.row_stride + c * l.step_x + k);
            each<kConv1Vectors>([&](auto v) INLINE_LAMBDA { sums[c][v] += inputs * load(w + v * kLanes); });
          });
      each<kFloatColumns>([&](auto c) INLINE_LAMBDA {
        float lanes[kConv1Vectors * kLanes];
        each<kConv1Vectors>([&](auto v) INLINE_LAMBDA { store(lanes + v * kLanes, sums[c][v]); });
        float* to = o + (y * l.size + x + c) * kConv1Outputs;
        for (int n = 0; n < kConv1Outputs; ++n) {
          to[n] = lanes[n * kTogether];
          for (int j = 1; j < kTogether; ++j) to[n] += lanes[n * kTogether + j];
        }
      });
    }
}

}  // namespace
}  // namespace bpn
