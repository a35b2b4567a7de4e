// Sizes of one network and of the arrays that a minibatch passes through.
#pragma once

#include <cstdint>

#include "shapes.h"

namespace bpn {

// Channels of a layer's arrays are padded to a multiple of this: whole vectors on every machine.
constexpr int kBlock = 16;
constexpr int padded(int size) { return (size + kBlock - 1) / kBlock * kBlock; }

// conv1 computes so many outputs together, from so many neighbouring inputs.
constexpr int kTogetherOutputs = 8;
constexpr int kTogetherPixels = 8;

// What a layer is, as the specification says it.
struct LayerShape {
  int in_size, in_channels, kernel, stride, outputs;
};

// One layer. A patch, in the order (kernel row, kernel column, channel), is `rows` runs of `run` neighbours in an image
// of `image` values, [row][column][channel as stored]. A connected layer's patch is all of its input, as one run.
struct Layer {
  bool connected;
  int rows, run, row_stride;  // of a patch
  int in_channels, in_width;  // of an input's position: true, and as stored
  int image;                  // values of one input image
  int size, step_y, step_x;   // output positions in each direction, and the patches' distances in values
  int outputs, width;         // output channels: true, and as stored

  int positions() const { return size * size; }
  int fan_in() const { return rows * run; }
  int columns() const { return run / in_width; }
  int in_rows() const { return image / row_stride; }
  int stride() const { return step_y / row_stride; }
  int row_words() const { return (run + 63) / 64; }  // of a patch's run as bits; in_width is a multiple of 8 then
  int patch_words() const { return rows * row_words(); }
  int bit_bytes() const { return (image + 63) / 64 * 8; }             // of one input image as bits
  int true_fan_in() const { return rows * columns() * in_channels; }  // as the weight vector has them
};

struct Geometry {
  int count = 0;
  Layer layers[kMaxLayers];

  // The shapes must be a chain, see `is_chain`.
  Geometry(const LayerShape* shapes, int layers_count) : count(layers_count) {
    int width = shapes[0].in_channels;
    for (int l = 0; l < count; ++l) {
      const LayerShape& shape = shapes[l];
      const bool connected = l > 0 && shape.kernel == shape.in_size;
      const int rows = connected ? 1 : shape.kernel, run = (connected ? shape.kernel : 1) * shape.kernel * width;
      const int row = shape.in_size * width;
      // A few outputs of conv1 are not padded, where the next layer's runs are whole vectors all the same.
      const bool narrow = l == 0 && shape.outputs <= kBlock / 2 && shapes[1].kernel % 2 == 0;
      const int outputs = narrow ? kBlock / 2 : padded(shape.outputs);
      layers[l] = {connected,
                   rows,
                   run,
                   row,
                   shape.in_channels,
                   width,
                   shape.in_size * row,
                   out_size(shape),
                   shape.stride * row,
                   shape.stride * width,
                   shape.outputs,
                   outputs};
      width = outputs;
    }
  }

  int norms() const { return count - 1; }  // batch norm follows every layer but the last

  static int out_size(const LayerShape& shape) { return (shape.in_size - shape.kernel) / shape.stride + 1; }

  // Whether the layers are a network's, each on the one before it, within the largest sizes (shapes.h).
  static bool is_chain(const LayerShape* shapes, int count) {
    if (count < 2 || count > kMaxLayers) return false;
    int size = shapes[0].in_size, channels = shapes[0].in_channels;
    if (size < 1 || size > kMaxImagePx || channels < 1 || channels > kMaxChannels) return false;
    for (int l = 0; l < count; ++l) {
      const LayerShape& shape = shapes[l];
      const bool whole = l > 0 && shape.kernel == size;
      if (shape.in_size != size || shape.in_channels != channels || shape.kernel < 1 || shape.kernel > size ||
          (shape.kernel > kMaxKernel && !whole) || shape.stride < 1 || shape.outputs < 1 ||
          shape.outputs > (whole ? kMaxOutputs : kMaxConvolutionChannels))
        return false;
      size = out_size(shape), channels = shape.outputs;
    }
    return size == 1;
  }
};

}  // namespace bpn
