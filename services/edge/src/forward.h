// The forward pass, written once over the primitives of an instruction set `Isa`:
//
//   kLanes, kOutputs               positions of conv1 in one vector; its output channels done together
//   Pixels load(bytes)             the 4 pixels of a tap for each lane
//   Signs broadcast(tap)           one tap's signs in every lane
//   Partial begin(Sums), dot(Partial, Pixels, Signs), Sums end(Sums, Partial)
//                                  adds the dot products of one channel (16 taps) to the sums
//   Sums mark_above(Sums bits, Sums sums, int32 floor, bit), store_bytes(out, bits)
//   Counts count(Counts, word, WordBlock), byte at_most(Counts, LimitBlock), store(out, Counts)
//                                  popcounts of XOR for 8 outputs
//
// Each Isa lives in an anonymous namespace and nothing here is a shared inline function: otherwise the linker
// would keep one path's instructions for all of them.
#pragma once

#include <cstring>

#include "paths.h"

#define UNROLL _Pragma("GCC unroll 16")

namespace bpn {

// Conv1 goes in bands of four output rows of 20 positions. Five vectors are done together, so that a sign is
// loaded once for five uses: one in each row's first 16 positions, and one in the "tails", the rows' last four
// positions side by side. Tiles of kLanes positions cover the 16.
constexpr int kBandRows = 4;
constexpr int kVectors = kBandRows + 1;
constexpr int kRowPositions = 16;
constexpr int kTailPositions = kConv1Size - kRowPositions;
constexpr int kTailBytes = kTailPositions * kTapPixels;
// Kernel row r of output row y is the input row 4q + phase with q = y + r / 4, phase = r % 4.
constexpr int kPhaseRows = kImagePx / kConv1Stride;

// The pixels that each tap meets in the tails.
struct Tails {
  uint8_t of[kMaxChannels][kConv1Stride][kTapsPerRow][kPhaseRows][kTailBytes];
};

static void gather_tails(int channels, const uint8_t* observation, Tails& tails) {
  const uint8_t* row = observation + kRowPositions * kTapPixels;
  for (int c = 0; c < channels; ++c)
    for (int q = 0; q < kPhaseRows; ++q)
      for (int phase = 0; phase < kConv1Stride; ++phase, row += kImagePx)
        for (int half = 0; half < kTapsPerRow; ++half)
          std::memcpy(tails.of[c][phase][half][q], row + half * kTapPixels, kTailBytes);
}

// The activation bits of output channels k0.. in one tile of a band, merged into `bits`. The loops over
// vectors and outputs must be unrolled for the sums to stay in registers.
template <class Isa>
void conv1_tile(const PixelLayer& layer, const uint8_t* observation, const Tails& tails, int y, int tile,
                int k0, typename Isa::Sums (&bits)[kVectors]) {
  typename Isa::Sums sums[kVectors][Isa::kOutputs] = {};
  for (int c = 0; c < layer.channels; ++c) {
    typename Isa::Partial partial[kVectors][Isa::kOutputs];
    UNROLL for (int v = 0; v < kVectors; ++v)
      UNROLL for (int k = 0; k < Isa::kOutputs; ++k) partial[v][k] = Isa::begin(sums[v][k]);
    UNROLL for (int tap = 0; tap < kTapsPerChannel; ++tap) {
      const int r = tap / kTapsPerRow, half = tap % kTapsPerRow;
      const uint8_t* pixels = observation + (c * kImagePx + y * kConv1Stride + r) * kImagePx +
                              (tile + half) * kTapPixels;
      typename Isa::Pixels x[kVectors];
      UNROLL for (int v = 0; v < kBandRows; ++v)
        x[v] = Isa::load(pixels + v * kConv1Stride * kImagePx);
      x[kBandRows] = Isa::load(
          &tails.of[c][r % kConv1Stride][half][y + r / kConv1Stride][0] + tile * kTapPixels);
      UNROLL for (int k = 0; k < Isa::kOutputs; ++k) {
        const auto signs = Isa::broadcast(layer.taps[c * kTapsPerChannel + tap][k0 + k]);
        UNROLL for (int v = 0; v < kVectors; ++v) partial[v][k] = Isa::dot(partial[v][k], x[v], signs);
      }
    }
    UNROLL for (int v = 0; v < kVectors; ++v)
      UNROLL for (int k = 0; k < Isa::kOutputs; ++k) sums[v][k] = Isa::end(sums[v][k], partial[v][k]);
  }
  UNROLL for (int v = 0; v < kVectors; ++v)
    UNROLL for (int k = 0; k < Isa::kOutputs; ++k)
      bits[v] = Isa::mark_above(bits[v], sums[v][k], layer.floors[k0 + k], 1 << (k0 + k));
}

template <class Isa>
void conv1(const PixelLayer& layer, const uint8_t* observation, uint8_t* out) {
  alignas(64) Tails tails;
  gather_tails(layer.channels, observation, tails);
  for (int y = 0; y < kConv1Size; y += kBandRows, out += kBandRows * kConv1Size) {
    uint8_t tail[kRowPositions];
    for (int tile = 0; tile < kRowPositions; tile += Isa::kLanes) {
      typename Isa::Sums bits[kVectors] = {};
      for (int k0 = 0; k0 < kConv1Outputs; k0 += Isa::kOutputs)
        conv1_tile<Isa>(layer, observation, tails, y, tile, k0, bits);
      for (int v = 0; v < kBandRows; ++v) Isa::store_bytes(out + v * kConv1Size + tile, bits[v]);
      Isa::store_bytes(tail + tile, bits[kBandRows]);
    }
    for (int v = 0; v < kBandRows; ++v)
      std::memcpy(out + v * kConv1Size + kRowPositions, tail + v * kTailPositions, kTailPositions);
  }
}

template <class Isa>
typename Isa::Counts count_block(const uint64_t* x, const WordBlock* weights, int words) {
  typename Isa::Counts counts = {};
  for (int w = 0; w < words; ++w) counts = Isa::count(counts, x[w], weights[w]);
  return counts;
}

// Conv2 and conv3 over a bit map, PixelBytes per pixel: a byte of the output for each block of channels.
// A patch's kernel rows are packed into words as many as fit whole. Reads up to 8 bytes past a row's bits.
template <class Isa, int OutSize, int Kernel, int Stride, int InSize, int Outputs, int Words>
void bit_convolution(const BitLayer<Outputs, Words>& layer, const uint8_t* in, uint8_t* out) {
  constexpr int kBlocks = Outputs / kBlock;
  constexpr int kPixelBytes = OutSize == kConv2Size ? kConv1Outputs / 8 : kConv2Outputs / 8;
  constexpr int kRowBits = Kernel * kPixelBytes * 8;
  constexpr int kRowsPerWord = Kernel / Words;
  for (int y = 0; y < OutSize; ++y)
    for (int x = 0; x < OutSize; ++x, out += kBlocks) {
      uint64_t patch[Words] = {};
      const uint8_t* from = in + (y * InSize + x) * Stride * kPixelBytes;
      UNROLL for (int r = 0; r < Kernel; ++r) {
        uint64_t row;
        std::memcpy(&row, from + r * InSize * kPixelBytes, sizeof row);
        row &= (uint64_t{1} << kRowBits) - 1;
        patch[r / kRowsPerWord] |= row << (r % kRowsPerWord * kRowBits);
      }
      UNROLL for (int b = 0; b < kBlocks; ++b)
        out[b] = Isa::at_most(count_block<Isa>(patch, layer.weights[b], Words), layer.limits[b]);
    }
}

template <class Isa>
void forward(const PackedNetwork& net, const uint8_t* observation, Activations& out) {
  conv1<Isa>(net.conv1, observation, out.conv1);
  bit_convolution<Isa, kConv2Size, kConv2Kernel, kConv2Stride, kConv1Size>(net.conv2, out.conv1, out.conv2);
  out.conv3[kFeatureWords - 1] = 0;  // the padding of the last word
  bit_convolution<Isa, kConv3Size, kConv3Kernel, 1, kConv2Size>(
      net.conv3, out.conv2, reinterpret_cast<uint8_t*>(out.conv3));

  out.fc1[net.fc2.words - 1] = 0;
  for (int b = 0; b < net.fc1.blocks; ++b)
    reinterpret_cast<uint8_t*>(out.fc1)[b] =
        Isa::at_most(count_block<Isa>(out.conv3, net.fc1.weights[b], kFeatureWords), net.fc1.limits[b]);
  for (int b = 0; b < net.fc2.blocks; ++b)
    Isa::store(out.differences + b * kBlock,
               count_block<Isa>(out.fc1, net.fc2.weights[b], net.fc2.words));
}

}  // namespace bpn
