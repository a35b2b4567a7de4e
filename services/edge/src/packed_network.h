// A policy in the layout that the forward pass reads: a fixed memory, like the block RAM of the hardware.
// Plain arrays on purpose: the paths (see forward.h) must not share inline library code.
#pragma once

#include <cstdint>

#include "geometry.h"

namespace bpn {

// A row-major int8 matrix of -1 and +1, [outputs][fan_in], and its thresholds (null for the last layer).
struct SignMatrix {
  const int8_t* signs;
  const int32_t* thresholds;
  int outputs;
  int fan_in;
};

// Layer 1. `taps[t][k]` are the four int8 signs of output channel k for tap t = (channel, kernel row,
// column half). Active iff o > `floors[k]`.
struct PixelLayer {
  int channels;
  uint32_t taps[kMaxChannels * kTapsPerChannel][kConv1Outputs];
  int32_t floors[kConv1Outputs];
};

struct alignas(64) WordBlock {
  uint64_t lane[kBlock];
};
struct alignas(64) LimitBlock {
  int64_t lane[kBlock];
};

// Layers 2-5. `weights[b][w]` is word w of the outputs 8b..8b+7. With d differing bits (popcount of XOR)
// o = fan_in - 2d, so o >= tau iff d <= `limits`; lanes beyond the last output are never active.
template <int MaxOutputs, int MaxWords>
struct BitLayer {
  int outputs;
  int fan_in;
  int blocks;
  int words;
  WordBlock weights[MaxOutputs / kBlock][MaxWords];
  LimitBlock limits[MaxOutputs / kBlock];
};

struct PackedNetwork {
  PixelLayer conv1;
  BitLayer<kConv2Outputs, 2> conv2;
  BitLayer<kConv3Outputs, kConv3Kernel> conv3;  // a word for each kernel row: three pixels of 16 bits
  BitLayer<kMaxNodes, kFeatureWords> fc1;
  BitLayer<kMaxActions, kMaxNodes / 64> fc2;
};

// Packs five matrices, whose sizes the caller has checked, into zeroed memory.
void pack_network(int channels, const SignMatrix (&layers)[kLayers], PackedNetwork& out);

// Room for what is read back: [outputs][fan_in] and [outputs] (null for the last layer).
struct ReadBack {
  int8_t* signs;
  int32_t* thresholds;
  int outputs;
  int fan_in;
};

// Reads five matrices, of the sizes that they were packed with, from the memory. Of the thresholds that decide
// alike it gives the one that any of them is packed as. False: the memory holds bits that no packing makes.
bool read_back(const PackedNetwork& packed, int channels, const ReadBack (&layers)[kLayers]);

// Over all of the memory; two memories that differ in one bit never have the same.
uint64_t checksum(const PackedNetwork& packed);

}  // namespace bpn
