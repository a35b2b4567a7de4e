/* The binarized policy's kernel from C: loads a weight blob (docs/weight-blob.md), runs it, shows every layer.
 *
 * Only `bpn_kernel_load` takes memory and only `bpn_kernel_free` gives it back: nothing else allocates, waits, fails,
 * reads files, or writes anywhere but into what it is given. No C++ exception leaves any function.
 *
 * Threads: an instance has its own scratch, so one thread at a time may use it; different instances, of the same bytes
 * too, are independent, and may be loaded and run at the same time.
 *
 * Link with libbpn_kernel.a and the C++ runtime that it was built with (-lstdc++ for GCC). */
#ifndef BPN_KERNEL_H
#define BPN_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum {
  BPN_MAX_LAYERS = 8,
  BPN_MAX_DIMENSIONS = 32, /* of an action */
  BPN_REASON_SIZE = 160    /* bytes of the longest reason, with its zero */
};

typedef struct bpn_kernel bpn_kernel;

/* One layer: `outputs` dot products at each of out_size x out_size positions. A fully connected one has out_size 1. */
typedef struct {
  int32_t in_size, in_channels, kernel, stride, out_size, outputs;
} bpn_layer;

typedef struct {
  int32_t schema;                      /* of the blob: 1 or 2 */
  int32_t channels, image_px;          /* of an observation: uint8[channels][image_px][image_px] */
  int32_t actions;                     /* outputs of the last layer */
  int32_t dimensions;                  /* of an action */
  int32_t choices[BPN_MAX_DIMENSIONS]; /* of each dimension; together they are the actions */
  int32_t layers;
  bpn_layer layer[BPN_MAX_LAYERS];
  float scale; /* lambda: the preferences are scale * outputs */
  uint8_t run[16];
  uint32_t attempt, version;
} bpn_policy;

/* Loads the bytes of a blob, which are not needed afterwards.
 *
 * path: which instructions, see `bpn_kernel_path`; NULL: the best that this processor has.
 * reason: room for BPN_REASON_SIZE bytes, or NULL. Where nothing is loaded it says why, in one line of ASCII.
 *
 * Returns the kernel, or NULL: the bytes are no blob or damaged, the path is none, or there is no memory. */
bpn_kernel* bpn_kernel_load(const void* blob, size_t size, const char* path, char* reason);

/* NULL is allowed. */
void bpn_kernel_free(bpn_kernel* kernel);

/* Geometry and provenance. They are the kernel's. */
const bpn_policy* bpn_kernel_policy(const bpn_kernel* kernel);

/* One inference.
 *
 * observation: uint8[channels][image_px][image_px], the newest frame's channels last.
 * outputs: int32[actions], the last layer's integers. */
void bpn_kernel_run(bpn_kernel* kernel, const uint8_t* observation, int32_t* outputs);

/* The activations of a layer but the last (0 is the first) in the last run.
 *
 * bits: uint8[out_size * out_size * outputs], 1 (+1) or 0 (-1), in the order row, column, channel.
 *
 * Returns how many they are; 0, and writes nothing, if there is no such layer. */
size_t bpn_kernel_trace(const bpn_kernel* kernel, int layer, uint8_t* bits);

/* Over all weights and thresholds in memory: differs after any one bit of them has flipped. */
uint64_t bpn_kernel_checksum(const bpn_kernel* kernel);

/* The name of the index-th path that this processor can run, the best first; NULL beyond the last. */
const char* bpn_kernel_path(int index);

#ifdef __cplusplus
}
#endif
#endif
