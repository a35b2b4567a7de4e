// conv1's outputs in floating point: as many inputs at a time as fit a vector beside eight outputs.
#pragma once

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

#include "extents.h"

namespace bpn {
namespace {

constexpr int kTogether = kLanes > kTogetherOutputs ? kLanes / kTogetherOutputs : 1;      // inputs in a vector
constexpr int kConv1Vectors = kLanes < kTogetherOutputs ? kTogetherOutputs / kLanes : 1;  // of the outputs
constexpr int kFloatColumns = kConv1Vectors > 1 ? 4 : 10;  // positions at a time; divides the paper's 20

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

// Eight outputs at so many neighbouring positions. `extents` are those of the patch's rows, `first` is where in them it
// begins.
template <int Columns>
inline void convolve_floats_at(const Layer& l, const float* patch, const Extent* extents, int first, const float* w,
                               float* o) {
  const int groups = (l.run + kTogether - 1) / kTogether, end = first + (Columns - 1) * l.step_x + l.run;
  Floats sums[Columns][kConv1Vectors] = {};
  for (int i = 0; i < l.rows; ++i) {
    if (first >= extents[i].end || end <= extents[i].begin) {
      w += groups * kConv1Vectors * kLanes;
      continue;
    }
    for (int k = 0; k < l.run; k += kTogether, w += kConv1Vectors * kLanes)
      each<Columns>([&](auto c) INLINE_LAMBDA {
        const Floats inputs = repeated(patch + i * l.row_stride + c * l.step_x + k);
        each<kConv1Vectors>([&](auto v) INLINE_LAMBDA { sums[c][v] += inputs * load(w + v * kLanes); });
      });
  }
  each<Columns>([&](auto c) INLINE_LAMBDA {
    float lanes[kConv1Vectors * kLanes];
    each<kConv1Vectors>([&](auto v) INLINE_LAMBDA { store(lanes + v * kLanes, sums[c][v]); });
    float* to = o + c * l.width;
    for (int n = 0; n < kTogetherOutputs; ++n) {
      to[n] = lanes[n * kTogether];
      for (int j = 1; j < kTogether; ++j) to[n] += lanes[n * kTogether + j];
    }
  });
}

inline void convolve_floats(const Layer& l, const float* image, const Extent* extents, const float* pixel_weights,
                            float* o) {
  const int block = l.rows * ((l.run + kTogether - 1) / kTogether) * kTogether * kTogetherOutputs;
  for (int first = 0; first < l.width; first += kTogetherOutputs, pixel_weights += block)
    for (int y = 0; y < l.size; ++y)
      for (int x = 0; x < l.size;) {
        const float* patch = image + y * l.step_y + x * l.step_x;
        float* to = o + (y * l.size + x) * l.width + first;
        const bool many = l.size - x >= kFloatColumns;
        const Extent* own = extents + y * l.stride();
        if (many)
          convolve_floats_at<kFloatColumns>(l, patch, own, x * l.step_x, pixel_weights, to);
        else
          convolve_floats_at<1>(l, patch, own, x * l.step_x, pixel_weights, to);
        x += many ? kFloatColumns : 1;
      }
}

}  // namespace
}  // namespace bpn
