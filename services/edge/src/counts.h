// Differing bits of a patch and eight outputs' weights.
#pragma once

#include <cstring>

#include "layout.h"

namespace bpn {

template <class Isa>
typename Isa::Counts count_block(const void* x, const WordBlock* weights, int words) {
  typename Isa::Counts counts = {};
  for (int w = 0; w < words; ++w) {
    uint64_t word;
    std::memcpy(&word, static_cast<const uint8_t*>(x) + w * sizeof word, sizeof word);
    counts = Isa::count(counts, word, weights[w]);
  }
  return counts;
}

}  // namespace bpn
