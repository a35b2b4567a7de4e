// Sizes of one network (paper, section V-A) and of the arrays that a minibatch passes through.
#pragma once

#include <cstdint>

namespace bpn {

constexpr int kLayers = 5;
constexpr int kNorms = kLayers - 1;  // batch norm follows every layer but the last
constexpr int kImagePx = 84;
constexpr int kConv1Outputs = 8;
constexpr int kMaxChannels = 16;
constexpr int kMaxNodes = 1024;
constexpr int kMaxActions = 64;

// Channels of a layer's arrays are padded to a multiple of this: whole vectors on every machine.
constexpr int kBlock = 16;
constexpr int padded(int size) { return (size + kBlock - 1) / kBlock * kBlock; }

// One layer. A patch, in the order (kernel row, kernel column, channel), is `rows` runs of `run`
// neighbours in an image of `image` values, [row][column][channel]; a fully connected layer's is one run.
struct Layer {
  int rows, run, row_stride;  // of a patch
  int image;                  // values of one input image
  int size, step_y, step_x;   // output positions in each direction, and the patches' distances in values
  int outputs, width;         // output channels: true, and as stored

  int positions() const { return size * size; }
  int fan_in() const { return rows * run; }
};

struct Geometry {
  Layer layers[kLayers];
  int run5;  // true inputs of the last layer: its run is padded

  Geometry(int channels, int nodes, int actions) {
    layers[0] = convolution(kImagePx, channels, 8, 4, kConv1Outputs, kConv1Outputs);
    layers[1] = convolution(20, kConv1Outputs, 4, 2, 16, 16);
    layers[2] = convolution(9, 16, 3, 1, 16, 16);
    layers[3] = fully_connected(7 * 7 * 16, nodes);
    layers[4] = fully_connected(padded(nodes), actions);
    run5 = nodes;
  }

  // Inputs of layer l's dot products as the weight vector has them.
  int true_fan_in(int l) const { return l == kLayers - 1 ? run5 : layers[l].fan_in(); }

 private:
  static Layer convolution(int in, int channels, int kernel, int stride, int outputs, int width) {
    return {kernel, kernel * channels, in * channels, in * in * channels, (in - kernel) / stride + 1,
            stride * in * channels, stride * channels, outputs, width};
  }
  static Layer fully_connected(int inputs, int outputs) {
    return {1, inputs, inputs, inputs, 1, 0, 0, outputs, padded(outputs)};
  }
};

}  // namespace bpn
