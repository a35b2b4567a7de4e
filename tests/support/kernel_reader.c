/* What the kernel's library makes of many blobs: on standard input, of each u32 size (little-endian) and its bytes; on
 * standard output a line for each, empty for one that it takes, else the reason. Each lies at the end of its memory. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bpn_kernel.h"

int main(void) {
  unsigned char head[4];
  while (fread(head, 1, 4, stdin) == 4) {
    const size_t size = head[0] | (size_t)head[1] << 8 | (size_t)head[2] << 16 | (size_t)head[3] << 24;
    unsigned char *blob = malloc(size ? size : 1);
    char reason[BPN_REASON_SIZE] = "";
    bpn_kernel *kernel;
    if (!blob || fread(blob, 1, size, stdin) != size) return 1;
    kernel = bpn_kernel_load(blob, size, NULL, reason);
    if (!kernel && !*reason) strcpy(reason, "no reason");
    puts(reason);
    free(blob);
    if (kernel) {
      const bpn_policy *policy = bpn_kernel_policy(kernel);
      unsigned char *image = calloc(policy->channels, (size_t)policy->image_px * policy->image_px);
      int32_t *outputs = malloc(sizeof *outputs * policy->actions);
      bpn_kernel_run(kernel, image, outputs);
      free(image), free(outputs);
    }
    bpn_kernel_free(kernel);
  }
  return 0;
}
