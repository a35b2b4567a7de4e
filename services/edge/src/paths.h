// The instruction-set paths: the same forward pass compiled once for each.
#pragma once

#include <cstdint>

#include "packed_network.h"

namespace bpn {

// Activation bits (1 = +1) in the order (row, column, channel), and the differing bits d of fc2's outputs.
// What is read as words is kept in words; conv1 and conv2 end in padding, as they are read 8 bytes at a time.
struct Activations {
  uint8_t conv1[kConv1Size * kConv1Size + 8];
  uint8_t conv2[kConv2Size * kConv2Size * kConv2Outputs / 8 + 8];
  uint64_t conv3[kFeatureWords];
  uint64_t fc1[kMaxNodes / 64];
  int64_t differences[kMaxActions];
};

using Forward = void(const PackedNetwork& network, const uint8_t* observation, Activations& out);

struct Path {
  const char* name;
  bool (*supported)();  // by this processor and its operating system
  Forward* forward;
};

// All compiled paths, best first; the last one runs anywhere.
struct PathList {
  const Path* first;
  int count;
};
PathList compiled_paths();

Forward forward_avx512_vnni;
Forward forward_avx_vnni;
Forward forward_avx2;
Forward forward_neon;
Forward forward_portable;

}  // namespace bpn
