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

#include "conv1.h"
#include "paths.h"

namespace bpn {

template <class Isa>
typename Isa::Counts count_block(const uint64_t* x, const WordBlock* weights, int words) {
  typename Isa::Counts counts = {};
  for (int w = 0; w < words; ++w) counts = Isa::count(counts, x[w], weights[w]);
  return counts;
}

// Conv2 and conv3, from one bit map to the next. A patch takes as many whole kernel rows per word as fit; each
// row is read as 8 bytes, of which the patch's are kept.
template <class Isa, int InSize, int InChannels, int Kernel, int Stride, int OutSize, int Outputs, int Words>
void bit_convolution(const BitLayer<Outputs, Words>& layer, const uint8_t* in, uint8_t* out) {
  constexpr int kBlocks = Outputs / kBlock;
  constexpr int kPixelBytes = InChannels / 8;
  constexpr int kRowBits = Kernel * kPixelBytes * 8;
  constexpr int kRowsPerWord = Kernel / Words;
  for (int y = 0; y < OutSize; ++y)
    for (int x = 0; x < OutSize; ++x, out += kBlocks) {
      uint64_t patch[Words] = {};
      const uint8_t* from = in + (y * InSize + x) * Stride * kPixelBytes;
      for (int r = 0; r < Kernel; ++r) {
        uint64_t row;
        std::memcpy(&row, from + r * InSize * kPixelBytes, sizeof row);
        row &= (uint64_t{1} << kRowBits) - 1;
        patch[r / kRowsPerWord] |= row << (r % kRowsPerWord * kRowBits);
      }
      for (int b = 0; b < kBlocks; ++b)
        out[b] = Isa::at_most(count_block<Isa>(patch, layer.weights[b], Words), layer.limits[b]);
    }
}

template <class Isa>
void forward(const PackedNetwork& net, const uint8_t* observation, Activations& out) {
  conv1<Isa>(net.conv1, observation, out.conv1);
  bit_convolution<Isa, kConv1Size, kConv1Outputs, kConv2Kernel, kConv2Stride, kConv2Size>(
      net.conv2, out.conv1, out.conv2);
  out.conv3[kFeatureWords - 1] = 0;  // the padding of the last word
  bit_convolution<Isa, kConv2Size, kConv2Outputs, kConv3Kernel, 1, kConv3Size>(
      net.conv3, out.conv2, reinterpret_cast<uint8_t*>(out.conv3));

  out.fc1[net.fc2.words - 1] = 0;  // as above
  for (int b = 0; b < net.fc1.blocks; ++b)
    reinterpret_cast<uint8_t*>(out.fc1)[b] =
        Isa::at_most(count_block<Isa>(out.conv3, net.fc1.weights[b], kFeatureWords), net.fc1.limits[b]);
  for (int b = 0; b < net.fc2.blocks; ++b)
    Isa::store(out.differences + b * kBlock,
               count_block<Isa>(out.fc1, net.fc2.weights[b], net.fc2.words));
}

}  // namespace bpn
