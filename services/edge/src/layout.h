// A policy in the layout that the forward pass reads, and what it leaves. Plain structures on purpose: the paths
// (see forward.h) must not share inline library code.
#pragma once

#include <cstdint>

#include "geometry.h"

namespace bpn {

// What a layer is, as the specification says it.
struct LayerShape {
  int in_size, in_channels, kernel, stride, out_size, outputs;
};

struct alignas(64) WordBlock {
  uint64_t lane[kBlock];
};
struct alignas(64) LimitBlock {
  int64_t lane[kBlock];
};

// Layer 1. `taps[t * 8 blocks + k]` are the four int8 signs of output channel k for tap t = (channel, kernel row,
// four kernel columns), zero beyond the kernel. Active iff o > `floors[k]`; channels beyond the last never are.
struct PixelLayer {
  LayerShape shape;
  int blocks;
  int groups;   // of four kernel columns
  int columns;  // output positions of a row, up to whole vectors
  uint32_t* taps;
  int32_t* floors;
};

// Layers from 2 on. Word w of the outputs 8b..8b+7 is `weights[b * words + w]`; a patch's bits lie in the order of
// the input's bit map. With d differing bits (popcount of XOR) o = fan_in - 2d, so o >= tau iff d <= `limits`; lanes
// beyond the last output are never active. The last layer has no limits.
struct BitLayer {
  LayerShape shape;
  int blocks;
  int in_bytes;  // of one position of the input's bit map
  int words;     // of a patch
  WordBlock* weights;
  LimitBlock* limits;
};

struct Layers {
  int count;
  PixelLayer first;
  BitLayer rest[kMaxLayers - 1];
};

// The bit maps of all layers but the last: bits (1 = +1) in the order (row, column, channel), each position in whole
// bytes. Behind a map are eight bytes of zeros, as it is read in words. Then the differing bits d of the last layer's
// outputs; and room for the pixels of a band of conv1 (see any_shape.h).
struct Activations {
  uint8_t* maps[kMaxLayers - 1];
  int64_t* differences;
  uint32_t* band;
};

}  // namespace bpn
