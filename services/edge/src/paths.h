// The instruction-set paths: the same forward pass compiled once for each.
#pragma once

#include <cstdint>

#include "layout.h"

namespace bpn {

using Forward = void(const Layers& network, const uint8_t* observation, const Activations& out);

struct Path {
  const char* name;
  bool (*supported)();  // by this processor and its operating system
  Forward* paper;       // for the paper's shape alone
  Forward* any;
};

// All compiled paths, best first; the last one runs anywhere.
struct PathList {
  const Path* first;
  int count;
};
PathList compiled_paths();

// That of a name which this processor can run, or null; without a name the best.
const Path* find_path(const char* name);

Forward paper_avx512_vnni, any_avx512_vnni;
Forward paper_avx_vnni, any_avx_vnni;
Forward paper_avx2, any_avx2;
Forward paper_neon_i8mm, any_neon_i8mm;
Forward paper_neon_dot, any_neon_dot;
Forward paper_neon, any_neon;
Forward any_portable;  // faster than the paper's there

}  // namespace bpn
