// Plain C++ for any processor.
#include "any_shape.h"
#include "paths.h"

namespace bpn {
namespace {

struct Portable {
  static constexpr int kLanes = 4;
  static constexpr int kOutputs = 1;
  static constexpr int kPixelOffset = 0;
  struct Sums {
    int32_t lane[kLanes];
  };
  struct Pixels {
    uint8_t byte[kLanes * kTapPixels];
  };
  struct Signs {
    int8_t byte[kTapPixels];
  };
  struct Counts {
    int64_t lane[kBlock];
  };
  using Partial = Sums;

  static Pixels load(const uint8_t* pixels) {
    Pixels x;
    std::memcpy(x.byte, pixels, sizeof x.byte);
    return x;
  }
  static Signs broadcast(uint32_t tap) {
    Signs w;
    std::memcpy(w.byte, &tap, sizeof w.byte);
    return w;
  }
  static Partial begin(Sums sums) { return sums; }
  static Partial dot(Partial sums, const Pixels& x, Signs w) {
    for (int i = 0; i < kLanes; ++i)
      for (int j = 0; j < kTapPixels; ++j) sums.lane[i] += x.byte[i * kTapPixels + j] * w.byte[j];
    return sums;
  }
  static Sums end(Sums, Partial sums) { return sums; }

  static Sums mark_above(Sums bits, Sums sums, int32_t floor, int bit) {
    for (int i = 0; i < kLanes; ++i) bits.lane[i] |= sums.lane[i] > floor ? bit : 0;
    return bits;
  }
  static void store_bytes(uint8_t* out, Sums bits) {
    for (int i = 0; i < kLanes; ++i) out[i] = static_cast<uint8_t>(bits.lane[i]);
  }

  static Counts count(Counts counts, uint64_t word, const WordBlock& weights) {
    for (int i = 0; i < kBlock; ++i) counts.lane[i] += __builtin_popcountll(word ^ weights.lane[i]);
    return counts;
  }
  static uint8_t at_most(Counts counts, const LimitBlock& limits) {
    int bits = 0;
    for (int i = 0; i < kBlock; ++i) bits |= (counts.lane[i] <= limits.lane[i]) << i;
    return static_cast<uint8_t>(bits);
  }
  static void store(int64_t* out, Counts counts) { std::memcpy(out, counts.lane, sizeof counts.lane); }
};

}  // namespace

void any_portable(const Layers& network, const uint8_t* observation, const Activations& out) {
  forward_any<Portable>(network, observation, out);
}

}  // namespace bpn
