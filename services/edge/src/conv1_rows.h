// Layer 1 of the paper's shape for instruction sets with vectors of 16 positions and 32 registers: nothing is copied,
// and every pixel is loaded once for all outputs. Beside what forward.h lists, `Isa` needs
//
//   kLanes = 16, kPixelOffset = 0
//   Pixels load_tails(bytes)       the same 4 positions of four output rows
//   void add_dot(Sums&, Pixels, Signs)
#pragma once

#include <cstring>

#include "layout.h"
#include "unrolled.h"

namespace bpn {

// Vectors that are done together: 3 x 8 sums, 3 vectors of pixels and a sign in 32 registers. A vector is the first 16
// positions of an output row, or the last four of four rows.
constexpr int kVectorRows = 3;
constexpr int kRowLanes = 16;
constexpr int kTailRows = 4, kTailLanes = kConv1Size - kRowLanes;
static_assert(kTailRows * kTailLanes == kRowLanes && kConv1Size % kTailRows == 0 && kConv1Stride == kTapPixels);
static_assert(kConv1Outputs == kBlock);

// The activation bits of all outputs at the positions of V vectors; `load(top, v)` is the pixels that a tap meets at
// those of vector v, with `top` the tap's first pixel at the first of all positions.
template <class Isa, int V, class Load>
INLINE void conv1_vectors(const PixelLayer layer, const uint8_t* top, Load load, typename Isa::Sums (&bits)[V]) {
  typename Isa::Sums sums[V][kConv1Outputs] = {};
  const uint32_t* signs = layer.taps;
  for (int c = 0; c < layer.shape.in_channels; ++c, top += (kImagePx - kConv1Kernel) * kImagePx)
    for (int row = 0; row < kConv1Kernel; ++row, top += kImagePx)
      unrolled<kTapsPerRow>([&](auto half) INLINE_LAMBDA {
        typename Isa::Pixels x[V];
        unrolled<V>([&](auto v) INLINE_LAMBDA { x[v.value] = load(top + half.value * kTapPixels, v.value); });
        unrolled<kConv1Outputs>([&](auto k) INLINE_LAMBDA {
          const typename Isa::Signs w = Isa::broadcast(signs[k.value]);
          unrolled<V>([&](auto v) INLINE_LAMBDA { Isa::add_dot(sums[v.value][k.value], x[v.value], w); });
        });
        signs += kConv1Outputs;
      });
  unrolled<kConv1Outputs>([&](auto k) INLINE_LAMBDA {
    unrolled<V>([&](auto v) INLINE_LAMBDA {
      bits[v.value] = Isa::mark_above(bits[v.value], sums[v.value][k.value], layer.floors[k.value], 1 << k.value);
    });
  });
}

template <class Isa, int V>
void conv1_rows(const PixelLayer layer, const uint8_t* observation, int y, uint8_t* out) {
  typename Isa::Sums bits[V] = {};
  const auto load = [](const uint8_t* tap, int v)
                        INLINE_LAMBDA { return Isa::load(tap + v * kConv1Stride * kImagePx); };
  conv1_vectors<Isa, V>(layer, observation + y * kConv1Stride * kImagePx, load, bits);
  for (int v = 0; v < V; ++v) Isa::store_bytes(out + (y + v) * kConv1Size, bits[v]);
}

template <class Isa, int V>
void conv1_tails(const PixelLayer layer, const uint8_t* observation, int y, uint8_t* out) {
  typename Isa::Sums bits[V] = {};
  const auto load = [](const uint8_t* tap, int v)
                        INLINE_LAMBDA { return Isa::load_tails(tap + v * kTailRows * kConv1Stride * kImagePx); };
  const uint8_t* const top = observation + y * kConv1Stride * kImagePx + kRowLanes * kConv1Stride;
  conv1_vectors<Isa, V>(layer, top, load, bits);
  for (int v = 0; v < V; ++v) {
    uint8_t bytes[kRowLanes];
    Isa::store_bytes(bytes, bits[v]);
    for (int row = 0; row < kTailRows; ++row)
      std::memcpy(out + (y + v * kTailRows + row) * kConv1Size + kRowLanes, bytes + row * kTailLanes, kTailLanes);
  }
}

template <class Isa>
void conv1_by_rows(const PixelLayer layer, const uint8_t* observation, uint8_t* out) {
  constexpr int kWhole = kConv1Size / kVectorRows * kVectorRows, kGroups = kConv1Size / kTailRows;
  constexpr int kWholeTails = kGroups / kVectorRows * kVectorRows;
  for (int y = 0; y < kWhole; y += kVectorRows) conv1_rows<Isa, kVectorRows>(layer, observation, y, out);
  conv1_rows<Isa, kConv1Size - kWhole>(layer, observation, kWhole, out);
  for (int group = 0; group < kWholeTails; group += kVectorRows)
    conv1_tails<Isa, kVectorRows>(layer, observation, group * kTailRows, out);
  conv1_tails<Isa, kGroups - kWholeTails>(layer, observation, kWholeTails * kTailRows, out);
}

}  // namespace bpn
