// Layer 1 of the paper's shape (see forward.h): dot products of pixels with signs, 77 % of all operations.
#pragma once

#include <cstring>

#include "layout.h"
#include "unrolled.h"

namespace bpn {

// Conv1 goes in bands of four output rows of 20 positions. Five vectors are done together, so that a sign is
// loaded once for five uses: one in each row's first 16 positions, and one in the "tail", the four rows' last
// four positions side by side. Tiles of kLanes positions cover the 16.
constexpr int kBandRows = 4;
constexpr int kVectors = kBandRows + 1;
constexpr int kRowPositions = 16;
constexpr int kTailPositions = kConv1Size - kRowPositions;
// Kernel row r of the band's output row v is the band's input row 4q + phase with q = v + r / 4, phase = r % 4.
static_assert(kConv1Size == 20 && kConv1Outputs == kBlock && kConv1Stride == kTapPixels && kConv1Kernel == 8);
constexpr int kPhaseRows = kBandRows + kConv1Kernel / kConv1Stride - 1;

// A band's pixels, copied so that those which one tap meets at neighbouring positions lie side by side, and
// the vectors of the rows do not straddle cache lines (which cost more than the copy).
struct alignas(64) TapPixels {
  uint8_t rows[kPhaseRows][kRowPositions * kTapPixels];
  uint8_t tails[kPhaseRows][kTailPositions * kTapPixels];
};
struct Band {
  TapPixels of[kMaxChannels][kConv1Stride][kTapsPerRow];
};

static void copy_band(int channels, const uint8_t* observation, int y, Band& band) {
  const uint8_t* top = observation + y * kConv1Stride * kImagePx;
  for (int c = 0; c < channels; ++c, top += kImagePx * kImagePx)
    for (int phase = 0; phase < kConv1Stride; ++phase)
      for (int half = 0; half < kTapsPerRow; ++half) {
        TapPixels& to = band.of[c][phase][half];
        const uint8_t* from = top + phase * kImagePx + half * kTapPixels;
        for (int q = 0; q < kPhaseRows; ++q, from += kConv1Stride * kImagePx) {
          std::memcpy(to.rows[q], from, sizeof to.rows[q]);
          std::memcpy(to.tails[q], from + sizeof to.rows[q], sizeof to.tails[q]);
        }
      }
}

// The activation bits of output channels k0.. in one tile of a band, merged into `bits`.
template <class Isa>
void conv1_tile(const PixelLayer layer, const Band& band, int tile, int k0, typename Isa::Sums (&bits)[kVectors]) {
  typename Isa::Sums sums[kVectors][Isa::kOutputs] = {};
  typename Isa::Partial partial[kVectors][Isa::kOutputs];
  const auto each_sum = [&](auto body) INLINE_LAMBDA {
    unrolled<Isa::kOutputs>(
        [&](auto k) INLINE_LAMBDA { unrolled<kVectors>([&](auto v) INLINE_LAMBDA { body(v.value, k.value); }); });
  };
  for (int c = 0; c < layer.shape.in_channels; ++c) {
    each_sum([&](int v, int k) INLINE_LAMBDA { partial[v][k] = Isa::begin(sums[v][k]); });
    unrolled<kTapsPerChannel>([&](auto tap) INLINE_LAMBDA {
      constexpr int r = tap.value / kTapsPerRow, half = tap.value % kTapsPerRow;
      constexpr int q = r / kConv1Stride;
      const TapPixels& pixels = band.of[c][r % kConv1Stride][half];
      const uint32_t* signs = layer.taps + (c * kTapsPerChannel + tap.value) * kConv1Outputs + k0;
      typename Isa::Pixels x[kVectors];
      unrolled<kBandRows>([&](auto v)
                              INLINE_LAMBDA { x[v.value] = Isa::load(pixels.rows[q + v.value] + tile * kTapPixels); });
      x[kBandRows] = Isa::load(pixels.tails[q] + tile * kTapPixels);
      each_sum([&](int v, int k)
                   INLINE_LAMBDA { partial[v][k] = Isa::dot(partial[v][k], x[v], Isa::broadcast(signs[k])); });
    });
    each_sum([&](int v, int k) INLINE_LAMBDA { sums[v][k] = Isa::end(sums[v][k], partial[v][k]); });
  }
  each_sum([&](int v, int k)
               INLINE_LAMBDA { bits[v] = Isa::mark_above(bits[v], sums[v][k], layer.floors[k0 + k], 1 << (k0 + k)); });
}

template <class Isa>
void conv1(PixelLayer layer, const uint8_t* observation, uint8_t* out) {
  int32_t floors[kConv1Outputs];
  if constexpr (Isa::kPixelOffset != 0) layer = with_offset<Isa>(layer, floors);
  Band band;
  for (int y = 0; y < kConv1Size; y += kBandRows, out += kBandRows * kConv1Size) {
    copy_band(layer.shape.in_channels, observation, y, band);
    uint8_t tail[kRowPositions];
    for (int tile = 0; tile < kRowPositions; tile += Isa::kLanes) {
      typename Isa::Sums bits[kVectors] = {};
      for (int k0 = 0; k0 < kConv1Outputs; k0 += Isa::kOutputs) conv1_tile<Isa>(layer, band, tile, k0, bits);
      for (int v = 0; v < kBandRows; ++v) Isa::store_bytes(out + v * kConv1Size + tile, bits[v]);
      Isa::store_bytes(tail + tile, bits[kBandRows]);
    }
    for (int v = 0; v < kBandRows; ++v)
      std::memcpy(out + v * kConv1Size + kRowPositions, tail + v * kTailPositions, kTailPositions);
  }
}

}  // namespace bpn
