// A policy in one fixed memory, like the block RAM of the hardware, and its way in and out of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <new>
#include <vector>

#include "layout.h"

namespace bpn {

// A row-major int8 matrix of -1 and +1, [outputs][fan_in], and its thresholds (null for the last layer).
struct SignMatrix {
  const int8_t* signs;
  const int32_t* thresholds;
};

// A layer's activations, one byte each, from its bit map: [row][column][channel], without what fills a position's
// bytes.
void unpack_bits(const uint8_t* map, const LayerShape& shape, uint8_t* bits);

// Room for what is read back: the same.
struct ReadBack {
  int8_t* signs;
  int32_t* thresholds;
};

constexpr size_t kAlignment = 64;

// Zeroed memory at a cache line's start.
class Memory {
 public:
  Memory() = default;
  explicit Memory(size_t size);

  unsigned char* data() const { return data_.get(); }
  size_t size() const { return size_; }

 private:
  struct Free {
    void operator()(unsigned char* memory) const { ::operator delete(memory, std::align_val_t{kAlignment}); }
  };
  std::unique_ptr<unsigned char, Free> data_;
  size_t size_ = 0;
};

inline int fan_in(const LayerShape& shape) { return shape.kernel * shape.kernel * shape.in_channels; }

// Whether the layers are a network's, each on the one before it, within the largest sizes (shapes.h).
bool is_chain(const std::vector<LayerShape>& shapes);

class Parts;

class PackedNetwork {
 public:
  // The layers must be a chain, and the matrices of their sizes.
  PackedNetwork(const std::vector<LayerShape>& shapes, const std::vector<SignMatrix>& matrices);

  const std::vector<LayerShape>& shapes() const { return shapes_; }
  const Layers& layers() const { return layers_; }
  const Memory& memory() const { return memory_; }

  // Whether only channels, hidden units and actions are other than the paper's.
  bool is_paper() const;

  // Every matrix, as it is in the memory. Of the thresholds that decide alike it gives the one that any of them is
  // packed as. False: the memory holds bits that no packing makes.
  bool read_back(const std::vector<ReadBack>& matrices) const;

  // Over all of the memory; two memories that differ in one bit never have the same.
  uint64_t checksum() const;

  // Bytes of scratch for one run, and where in them everything lies; zeroed where they are read without being written.
  size_t scratch_size() const { return scratch_size_; }
  Activations activations(unsigned char* scratch) const;

  // The last layer's integers o, from what a run left.
  void outputs(const Activations& activations, int32_t* o) const;

 private:
  Activations laid_out(Parts& parts) const;

  std::vector<LayerShape> shapes_;
  Layers layers_{};
  Memory memory_;
  std::vector<size_t> map_bytes_;
  size_t scratch_size_ = 0;
};

}  // namespace bpn
