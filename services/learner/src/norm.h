// Batch norm with the minibatch's statistics and Sign, forward and backward, eight channels at a time.
#pragma once

#include <cmath>

#include "bits.h"
#include "minibatch.h"

namespace bpn {
namespace {

using EightDoubles = double __attribute__((vector_size(64)));

constexpr int kChains = 4;  // of sums, so that none waits for the one before it
constexpr double kEpsilon = 1e-5;
constexpr float kPassBound = 1.0f + 0x1p-23f;  // the straight-through gradient passes where |z| <= this

inline EightDoubles as_doubles(Eight v) { return __builtin_convertvector(v, EightDoubles); }
inline Eight as_floats(EightDoubles v) { return __builtin_convertvector(v, Eight); }

// o [n][width] becomes normalized, s its sign after gamma and beta, and `bits` s as bits (of an image from whole words
// on), with the statistics of the whole minibatch.
// The sums of integers and of their squares are exact in double: the statistics do not depend on any order,
// nor on how a minibatch is shared.
inline void normalize(const Batch& batch, const Layer& layer, float* o, const float* gamma, const float* beta,
                      float* norm_scale, float* s, uint8_t* bits, int bit_bytes) {
  const int n = batch.size * layer.positions(), width = layer.width;
  const double total = double(batch.total) * layer.positions();
  double sums[2 * kMaxOutputs];  // of the values, of their squares
  for (int c = 0; c < width; c += 8) {
    EightDoubles sum[kChains] = {}, squares[kChains] = {};
    for (int i = 0; i < n; i += kChains)
      each<kChains>([&](auto k) INLINE_LAMBDA {
        if (i + k >= n) return;
        const EightDoubles value = as_doubles(loaded<Eight>(o + (i + k) * width + c));
        sum[k] += value;
        squares[k] += value * value;
      });
    for (int k = 1; k < kChains; ++k) sum[0] += sum[k], squares[0] += squares[k];
    store(sums + c, sum[0]), store(sums + width + c, squares[0]);
  }
  batch.exchange(sums, 2 * width);
  for (int c = 0; c < width; c += 8) {
    const EightDoubles mean = loaded<EightDoubles>(sums + c) / total;
    EightDoubles scale;
    for (int k = 0; k < 8; ++k) {
      const double variance = sums[width + c + k] / total - mean[k] * mean[k];
      scale[k] = 1 / std::sqrt((variance > 0 ? variance : 0) + kEpsilon);
    }
    store(norm_scale + c, as_floats(scale));
    const Eight a = loaded<Eight>(gamma + c), b = loaded<Eight>(beta + c);
    float *value = o + c, *sign = s + c;
    for (int image = 0; image < batch.size; ++image) {
      uint8_t* to = bits + image * bit_bytes + c / 8;
      for (int i = 0; i < layer.positions(); ++i, value += width, sign += width, to += width / 8) {
        const Eight normalized = as_floats((as_doubles(loaded<Eight>(value)) - mean) * scale);
        store(value, normalized);
        const Eight z = normalized * a + b;
        store(sign, z >= 0 ? Eight{} + 1 : Eight{} - 1);
        *to = sign_bits(z);
      }
    }
  }
}

// g, the gradient of s, becomes that of o; this share's sums for gamma and beta are left in theirs.
inline void normalize_back(const Batch& batch, const Layer& layer, float* g, const float* normalized,
                           const float* gamma, const float* beta, const float* norm_scale, float* d_gamma,
                           float* d_beta) {
  const int n = batch.size * layer.positions(), width = layer.width;
  const double total = double(batch.total) * layer.positions();
  double sums[2 * kMaxOutputs];  // of what passes Sign, of its products with the normalized values
  for (int c = 0; c < width; c += 8) {
    const Eight a = loaded<Eight>(gamma + c), b = loaded<Eight>(beta + c);
    EightDoubles sum = {}, products = {};
    for (int i = 0; i < n; ++i) {
      const Eight x = loaded<Eight>(normalized + i * width + c);
      const Eight z = x * a + b;
      Eight passed = loaded<Eight>(g + i * width + c);
      passed = (z < kPassBound) & (z > -kPassBound) ? passed : Eight{};
      store(g + i * width + c, passed);
      sum += as_doubles(passed);
      products += as_doubles(passed * x);
    }
    store(d_beta + c, as_floats(sum));
    store(d_gamma + c, as_floats(products));
    store(sums + c, sum), store(sums + width + c, products);
  }
  batch.exchange(sums, 2 * width);
  for (int c = 0; c < width; c += 8) {
    const Eight mean = as_floats(loaded<EightDoubles>(sums + c) / total);
    const Eight slope = as_floats(loaded<EightDoubles>(sums + width + c) / total);
    const Eight scale = loaded<Eight>(gamma + c) * loaded<Eight>(norm_scale + c);
    for (int i = 0; i < n; ++i) {
      float* at = g + i * width + c;
      store(at, scale * (loaded<Eight>(at) - mean - slope * loaded<Eight>(normalized + i * width + c)));
    }
  }
}

}  // namespace
}  // namespace bpn
