// The forward pass, for the paper's shape here and for any other in any_shape.h, written once over the primitives of
// an instruction set `Isa`:
//
//   kLanes, kOutputs               positions of conv1 in one vector; its output channels done together
//   Pixels load(bytes)             the 4 pixels of a tap for each lane, less kPixelOffset
//   Signs broadcast(tap)           one tap's signs in every lane
//   Partial begin(Sums), dot(Partial, Pixels, Signs), Sums end(Sums, Partial)
//                                  adds the dot products of one channel (at most 64 taps) to the sums
//   Sums mark_above(Sums bits, Sums sums, int32 floor, bit), store_bytes(out, bits)
//   Counts count(Counts, word, WordBlock), byte at_most(Counts, LimitBlock), store(out, Counts)
//                                  popcounts of XOR for 8 outputs
//
// Layers are passed by value: bytes that are stored could otherwise be theirs, for all that a compiler knows.
//
// Each Isa lives in an anonymous namespace and nothing here is a shared inline function: otherwise the linker
// would keep one path's instructions for all of them.
#pragma once

#include <cstring>

#include "any_shape.h"
#include "conv1.h"
#include "counts.h"
#include "paths.h"

namespace bpn {

// Conv2 and conv3, from one bit map to the next: sizes that are known beforehand keep a patch in registers. Each
// kernel row is read as 8 bytes, of which the patch's are kept.
template <class Isa, int InSize, int InChannels, int Kernel, int Stride, int OutSize, int Outputs>
void bit_convolution(const BitLayer layer, const uint8_t* in, uint8_t* out) {
  constexpr int kBlocks = Outputs / kBlock;
  constexpr int kPixelBytes = InChannels / 8;
  constexpr int kRowBits = Kernel * kPixelBytes * 8;
  constexpr int kWords = ceil_div(Kernel * kRowBits, 64);
  static_assert(kRowBits < 64);
  for (int y = 0; y < OutSize; ++y)
    for (int x = 0; x < OutSize; ++x, out += kBlocks) {
      uint64_t patch[kWords] = {};
      const uint8_t* from = in + (y * InSize + x) * Stride * kPixelBytes;
      unrolled<Kernel>([&](auto r) INLINE_LAMBDA {
        constexpr int at = r.value * kRowBits, word = at / 64, shift = at % 64;
        uint64_t row;
        std::memcpy(&row, from + r.value * InSize * kPixelBytes, sizeof row);
        row &= (uint64_t{1} << kRowBits) - 1;
        patch[word] |= row << shift;
        if constexpr (shift + kRowBits > 64) patch[word + 1] |= row >> (64 - shift);
      });
      for (int b = 0; b < kBlocks; ++b)
        out[b] = Isa::at_most(count_block<Isa>(patch, layer.weights + b * kWords, kWords), layer.limits[b]);
    }
}

// All layers but the first.
template <class Isa>
void paper_bit_layers(const Layers& net, const Activations& out) {
  const BitLayer conv2 = net.rest[0], conv3 = net.rest[1], fc1 = net.rest[2], fc2 = net.rest[3];
  bit_convolution<Isa, kConv1Size, kConv1Outputs, kConv2Kernel, kConv2Stride, kConv2Size, kConv2Outputs>(
      conv2, out.maps[0], out.maps[1]);
  bit_convolution<Isa, kConv2Size, kConv2Outputs, kConv3Kernel, kConv3Stride, kConv3Size, kConv3Outputs>(
      conv3, out.maps[1], out.maps[2]);
  uint8_t* const hidden = out.maps[3];
  const uint8_t* const features = out.maps[2];
  for (int b = 0; b < fc1.blocks; ++b)
    hidden[b] = Isa::at_most(count_block<Isa>(features, fc1.weights + b * kFeatureWords, kFeatureWords), fc1.limits[b]);
  for (int b = 0; b < fc2.blocks; ++b)
    Isa::store(out.differences + b * kBlock, count_block<Isa>(out.maps[3], fc2.weights + b * fc2.words, fc2.words));
}

template <class Isa>
void forward_paper(const Layers& net, const uint8_t* observation, const Activations& out) {
  conv1<Isa>(net.first, observation, out.maps[0]);
  paper_bit_layers<Isa>(net, out);
}

}  // namespace bpn
