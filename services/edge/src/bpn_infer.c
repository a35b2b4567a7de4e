/* What a policy makes of observations: an example of bpn_kernel.h in C99, and what its tests run on every processor.
 *
 *   bpn-infer --paths                         the instruction-set paths of this processor, the best first
 *   bpn-infer BLOB                            the policy's geometry
 *   bpn-infer BLOB OBSERVATIONS [--path NAME] [--trace]
 *
 * OBSERVATIONS: a file of uint8[C][P][P], one behind the other; "-" is standard input. Of each, a line with the last
 * layer's integers and, behind a colon, the best choice of every dimension; with --trace the activations of each layer
 * before, 0 and 1, a line each. Status 2: why it cannot be, on standard error. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bpn_kernel.h"

static int failed(const char *what, const char *why) {
  fprintf(stderr, "bpn-infer: %s: %s\n", what, why);
  return 2;
}

/* All bytes of a file; NULL where it cannot be read or there is no memory. */
static unsigned char *read_all(const char *name, size_t *size) {
  FILE *file = fopen(name, "rb");
  unsigned char *data = NULL;
  size_t room = 0;
  *size = 0;
  if (!file) return NULL;
  for (;;) {
    unsigned char *more = *size < room ? data : realloc(data, room = 2 * room + 65536);
    size_t got;
    if (!more) break;
    data = more;
    got = fread(data + *size, 1, room - *size, file);
    *size += got;
    if (got == 0 && !ferror(file)) {
      fclose(file);
      return data;
    }
    if (ferror(file)) break;
  }
  free(data);
  fclose(file);
  return NULL;
}

static void describe(const bpn_policy *policy) {
  int l, d;
  printf("schema %d, observation uint8[%d][%d][%d], %d actions (", policy->schema, policy->channels, policy->image_px,
         policy->image_px, policy->actions);
  for (d = 0; d < policy->dimensions; ++d) printf(d ? "+%d" : "%d", policy->choices[d]);
  printf("), lambda %.9g, version %u\n", policy->scale, policy->version);
  for (l = 0; l < policy->layers; ++l) {
    const bpn_layer *layer = &policy->layer[l];
    printf("layer %d: %d x %d x %d, kernel %d, stride %d, to %d x %d x %d\n", l + 1, layer->in_size, layer->in_size,
           layer->in_channels, layer->kernel, layer->stride, layer->out_size, layer->out_size, layer->outputs);
  }
}

static void tell_bits(const unsigned char *bits, size_t count) {
  size_t i;
  for (i = 0; i < count; ++i) putchar('0' + bits[i]);
  putchar('\n');
}

static void tell_outputs(const bpn_policy *policy, const int32_t *outputs) {
  int d, a, first = 0;
  for (a = 0; a < policy->actions; ++a) printf("%d ", outputs[a]);
  putchar(':');
  for (d = 0; d < policy->dimensions; first += policy->choices[d], ++d) {
    int best = first;
    for (a = first; a < first + policy->choices[d]; ++a)
      if (outputs[a] > outputs[best]) best = a;
    printf(" %d", best - first);
  }
  putchar('\n');
}

/* Room for the activations of any layer. */
static size_t most_bits(const bpn_policy *policy) {
  size_t most = 1;
  int l;
  for (l = 0; l < policy->layers; ++l) {
    const bpn_layer *layer = &policy->layer[l];
    const size_t own = (size_t)layer->out_size * layer->out_size * layer->outputs;
    if (own > most) most = own;
  }
  return most;
}

static int run(bpn_kernel *kernel, const char *name, int trace) {
  const bpn_policy *policy = bpn_kernel_policy(kernel);
  const size_t pixels = (size_t)policy->channels * policy->image_px * policy->image_px;
  unsigned char *observation = malloc(pixels), *bits = malloc(most_bits(policy));
  int32_t *outputs = malloc(sizeof *outputs * policy->actions);
  FILE *file = strcmp(name, "-") == 0 ? stdin : fopen(name, "rb");
  size_t got = 0;
  int l, status = 0;
  if (!observation || !bits || !outputs)
    status = failed(name, "there is no memory");
  else if (!file)
    status = failed(name, "cannot be read");
  while (status == 0 && (got = fread(observation, 1, pixels, file)) == pixels) {
    bpn_kernel_run(kernel, observation, outputs);
    for (l = 0; trace && l + 1 < policy->layers; ++l) tell_bits(bits, bpn_kernel_trace(kernel, l, bits));
    tell_outputs(policy, outputs);
  }
  if (status == 0 && got != 0) status = failed(name, "it ends within an observation");
  if (file && file != stdin) fclose(file);
  free(observation), free(bits), free(outputs);
  return status;
}

int main(int count, char **arguments) {
  const char *blob = NULL, *observations = NULL, *path = NULL;
  char reason[BPN_REASON_SIZE];
  unsigned char *data;
  bpn_kernel *kernel;
  size_t size;
  int i, trace = 0, status = 0;
  for (i = 1; i < count; ++i) {
    if (strcmp(arguments[i], "--paths") == 0) {
      for (i = 0; bpn_kernel_path(i); ++i) puts(bpn_kernel_path(i));
      return 0;
    }
    if (strcmp(arguments[i], "--trace") == 0)
      trace = 1;
    else if (strcmp(arguments[i], "--path") == 0 && i + 1 < count)
      path = arguments[++i];
    else if (!blob)
      blob = arguments[i];
    else
      observations = arguments[i];
  }
  if (!blob) return failed("usage", "bpn-infer BLOB [OBSERVATIONS] [--path NAME] [--trace], or bpn-infer --paths");
  data = read_all(blob, &size);
  if (!data) return failed(blob, "cannot be read");
  kernel = bpn_kernel_load(data, size, path, reason);
  free(data);
  if (!kernel) return failed(blob, reason);
  if (observations)
    status = run(kernel, observations, trace);
  else
    describe(bpn_kernel_policy(kernel));
  bpn_kernel_free(kernel);
  return status;
}
