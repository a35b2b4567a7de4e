// The forward pass (see forward.h) of any chain of layers, whose sizes are known when it is loaded.
#pragma once

#include <cstring>

#include "counts.h"
#include "unrolled.h"

namespace bpn {

// The layer with floors for pixels as `load` gives them; `floors` is room for those.
template <class Isa>
PixelLayer with_offset(PixelLayer layer, int32_t* floors) {
  const int width = layer.blocks * kBlock, taps = layer.shape.in_channels * layer.shape.kernel * layer.groups;
  for (int k = 0; k < width; ++k) {
    int sum = 0;  // of the output's signs
    for (int t = 0; t < taps; ++t)
      for (int byte = 0; byte < kTapPixels; ++byte) sum += static_cast<int8_t>(layer.taps[t * width + k] >> (8 * byte));
    floors[k] = layer.floors[k] - Isa::kPixelOffset * sum;
  }
  layer.floors = floors;
  return layer;
}

// Copies the pixels of a band of output rows from row y on: for every channel, image row and four kernel columns those
// that neighbouring positions meet, side by side. What lies beyond the kernel meets signs of zero.
static void copy_any_band(const PixelLayer layer, const uint8_t* observation, int y, uint32_t* band) {
  const LayerShape shape = layer.shape;
  const int rows = (kAnyRows - 1) * shape.stride + shape.kernel;
  uint8_t pixels[kMaxImagePx + kTapPixels] = {};
  for (int c = 0; c < shape.in_channels; ++c)
    for (int q = 0; q < rows; ++q, band += layer.groups * layer.columns) {
      const int row = y * shape.stride + q;
      if (row >= shape.in_size) continue;  // of output rows that there are not
      std::memcpy(pixels, observation + (c * shape.in_size + row) * shape.in_size, shape.in_size);
      for (int g = 0; g < layer.groups; ++g) {
        uint32_t* to = band + g * layer.columns;
        const uint8_t* from = pixels + g * kTapPixels;
        if (shape.stride == kTapPixels)
          std::memcpy(to, from, shape.out_size * kTapPixels);
        else
          for (int x = 0; x < shape.out_size; ++x) std::memcpy(to + x, from + x * shape.stride, kTapPixels);
      }
    }
}

// The activation bits of output channels k0.. at a vector of positions of each of a band's rows, merged into `bits`.
template <class Isa>
void any_tile(const PixelLayer layer, const uint32_t* band, int k0, typename Isa::Sums (&bits)[kAnyRows]) {
  typename Isa::Sums sums[kAnyRows][Isa::kOutputs] = {};
  typename Isa::Partial partial[kAnyRows][Isa::kOutputs];
  const auto each_sum = [&](auto body) INLINE_LAMBDA {
    unrolled<Isa::kOutputs>(
        [&](auto k) INLINE_LAMBDA { unrolled<kAnyRows>([&](auto v) INLINE_LAMBDA { body(v.value, k.value); }); });
  };
  const int stride = layer.shape.stride, row_taps = layer.groups * layer.columns;
  const uint32_t* signs = layer.taps + k0;
  for (int c = 0; c < layer.shape.in_channels; ++c, band += ((kAnyRows - 1) * stride + layer.shape.kernel) * row_taps) {
    each_sum([&](int v, int k) INLINE_LAMBDA { partial[v][k] = Isa::begin(sums[v][k]); });
    for (int r = 0; r < layer.shape.kernel; ++r)
      for (int g = 0; g < layer.groups; ++g, signs += layer.blocks * kBlock) {
        typename Isa::Pixels x[kAnyRows];
        unrolled<kAnyRows>([&](auto v) INLINE_LAMBDA {
          const uint32_t* taps = band + (v.value * stride + r) * row_taps + g * layer.columns;
          x[v.value] = Isa::load(reinterpret_cast<const uint8_t*>(taps));
        });
        each_sum([&](int v, int k)
                     INLINE_LAMBDA { partial[v][k] = Isa::dot(partial[v][k], x[v], Isa::broadcast(signs[k])); });
      }
    each_sum([&](int v, int k) INLINE_LAMBDA { sums[v][k] = Isa::end(sums[v][k], partial[v][k]); });
  }
  each_sum([&](int v, int k) INLINE_LAMBDA {
    bits[v] = Isa::mark_above(bits[v], sums[v][k], layer.floors[k0 + k], 1 << ((k0 + k) % kBlock));
  });
}

template <class Isa>
void any_conv1(PixelLayer layer, const uint8_t* observation, uint32_t* band, uint8_t* out) {
  int32_t floors[kMaxOutputs];
  if constexpr (Isa::kPixelOffset != 0) layer = with_offset<Isa>(layer, floors);
  const int size = layer.shape.out_size;
  for (int y = 0; y < size; y += kAnyRows) {
    copy_any_band(layer, observation, y, band);
    for (int x = 0; x < size; x += Isa::kLanes)
      for (int b = 0; b < layer.blocks; ++b) {
        typename Isa::Sums bits[kAnyRows] = {};
        for (int k = 0; k < kBlock; k += Isa::kOutputs) any_tile<Isa>(layer, band + x, b * kBlock + k, bits);
        for (int v = 0; v < kAnyRows && y + v < size; ++v) {
          uint8_t bytes[kMaxLanes];
          Isa::store_bytes(bytes, bits[v]);
          uint8_t* to = out + ((y + v) * size + x) * layer.blocks + b;
          for (int i = 0; i < Isa::kLanes && x + i < size; ++i) to[i * layer.blocks] = bytes[i];
        }
      }
  }
}

// A patch's kernel rows one after the other, in words.
static void copy_patch(const BitLayer layer, const uint8_t* from, uint64_t* patch) {
  std::memset(patch, 0, layer.words * sizeof *patch);
  const int row_bytes = layer.shape.kernel * layer.in_bytes;
  int at = 0;  // bits
  for (int r = 0; r < layer.shape.kernel; ++r, from += layer.shape.in_size * layer.in_bytes)
    for (int byte = 0; byte < row_bytes; byte += 8) {
      const int bits = 8 * (row_bytes - byte < 8 ? row_bytes - byte : 8), shift = at % 64;
      uint64_t word;
      std::memcpy(&word, from + byte, sizeof word);
      if (bits < 64) word &= (uint64_t{1} << bits) - 1;
      patch[at / 64] |= word << shift;
      if (shift + bits > 64) patch[at / 64 + 1] |= word >> (64 - shift);
      at += bits;
    }
}

// From one bit map to the next, or to the differing bits of the last layer.
template <class Isa>
void any_bit_layer(const BitLayer layer, const uint8_t* in, uint8_t* out, int64_t* differences) {
  const LayerShape shape = layer.shape;
  uint64_t copy[kMaxPatchWords];
  for (int y = 0; y < shape.out_size; ++y)
    for (int x = 0; x < shape.out_size; ++x, out += layer.blocks) {
      const void* patch = in;
      if (shape.kernel < shape.in_size) {  // or it is the whole map
        copy_patch(layer, in + (y * shape.in_size + x) * shape.stride * layer.in_bytes, copy);
        patch = copy;
      }
      for (int b = 0; b < layer.blocks; ++b) {
        const auto counts = count_block<Isa>(patch, layer.weights + b * layer.words, layer.words);
        if (differences)
          Isa::store(differences + b * kBlock, counts);
        else
          out[b] = Isa::at_most(counts, layer.limits[b]);
      }
    }
}

template <class Isa>
void forward_any(const Layers& net, const uint8_t* observation, const Activations& out) {
  any_conv1<Isa>(net.first, observation, out.band, out.maps[0]);
  const int rest = net.count - 1;
  for (int l = 0; l < rest; ++l) {
    const bool last = l == rest - 1;
    any_bit_layer<Isa>(net.rest[l], out.maps[l], last ? nullptr : out.maps[l + 1], last ? out.differences : nullptr);
  }
}

}  // namespace bpn
