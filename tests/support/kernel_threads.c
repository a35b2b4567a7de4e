/* Four threads, each with a kernel of its own from the same bytes, run one observation at the same time, and every
 * memory that is taken is counted. Status 0: all outputs are equal, and none was taken after loading. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bpn_kernel.h"

enum { THREADS = 4, RUNS = 200, MAX_FILE = 1 << 20 };

static atomic_long taken;
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
static void *counted(void *memory) {
  atomic_fetch_add(&taken, 1);
  return memory;
}
void *malloc(size_t size) { return counted(__libc_malloc(size)); }
void *calloc(size_t count, size_t size) { return counted(__libc_calloc(count, size)); }
void *realloc(void *old, size_t size) { return counted(__libc_realloc(old, size)); }
void *aligned_alloc(size_t alignment, size_t size) { return counted(__libc_memalign(alignment, size)); }
int posix_memalign(void **to, size_t alignment, size_t size) {
  *to = counted(__libc_memalign(alignment, size));
  return *to ? 0 : 12;
}

static unsigned char blob[MAX_FILE], image[MAX_FILE];
static size_t blob_size;
static int32_t outputs[THREADS][64];
static unsigned char bits[THREADS][MAX_FILE / 8];
static bpn_kernel *kernels[THREADS];

static void *run(void *argument) {
  const int own = *(const int *)argument;
  int i, l;
  for (i = 0; i < RUNS; ++i) {
    bpn_kernel_run(kernels[own], image, outputs[own]);
    for (l = 0; bpn_kernel_trace(kernels[own], l, bits[own]); ++l) continue;
    bpn_kernel_checksum(kernels[own]);
  }
  return NULL;
}

static void *load(void *argument) {
  kernels[*(const int *)argument] = bpn_kernel_load(blob, blob_size, NULL, NULL);
  return NULL;
}

static void in_threads(void *(*work)(void *)) {
  static int numbers[THREADS];
  pthread_t threads[THREADS];
  int i;
  for (i = 0; i < THREADS; ++i) numbers[i] = i, pthread_create(&threads[i], NULL, work, &numbers[i]);
  for (i = 0; i < THREADS; ++i) pthread_join(threads[i], NULL);
}

int main(int count, char **arguments) {
  FILE *file = count > 2 ? fopen(arguments[1], "rb") : NULL, *answers = count > 2 ? fopen(arguments[2], "rb") : NULL;
  long before;
  int i, number = 0;
  if (!file || !answers) return 2;
  blob_size = fread(blob, 1, sizeof blob, file);
  if (fseek(answers, 4, SEEK_SET) || !fread(image, 1, sizeof image, answers)) return 2;
  in_threads(load);
  before = atomic_load(&taken);
  for (i = 0; i < 5; ++i) run(&number);
  if (before == 0 || atomic_load(&taken) != before) return puts("memory was taken"), 1;
  in_threads(run);
  for (i = 0; i < THREADS; ++i) {
    if (memcmp(outputs[0], outputs[i], sizeof outputs[0]) != 0) return puts("threads differ"), 1;
    bpn_kernel_free(kernels[i]);
  }
  return 0;
}
