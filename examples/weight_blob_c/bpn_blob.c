/* Reads a weight blob and computes its network: C99, from docs/weight-blob.md alone.
 *
 *   cc -std=c99 -O2 -Wall -Wextra -pedantic bpn_blob.c -o bpn_blob
 *   ./bpn_blob BLOB            its shape, or why it is refused (status 2)
 *   ./bpn_blob BLOB ANSWERS    every layer's integers against tests/vectors/NAME.bin (status 1: they differ)
 *
 * It is written to be read: plain sums, one sign at a time. Fast kernels are in services/edge/src. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_LAYERS = 8, MAX_DIMS = 32, DIGEST = 32, MAX_FILE = 4 << 20 };

typedef struct {
  int s, c, k, d, m; /* input size and channels, kernel, stride, outputs */
  int t, n;          /* output size; signs of one output */
  const uint8_t *signs;
  size_t row_bits;           /* from the first sign of an output to the first of the next, in bits */
  const uint8_t *thresholds; /* none of the last layer */
} Layer;

typedef struct {
  int schema, C, P, L, D;
  int choices[MAX_DIMS];
  float lambda;
  Layer layers[MAX_LAYERS];
} Network;

/* ---- SHA-256 (FIPS 180-4) ---- */

static uint32_t rotated(uint32_t x, int by) { return x >> by | x << (32 - by); }

static const uint32_t K[64] = {
    0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
    0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
    0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
    0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
    0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
    0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
    0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
    0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

static void sha256_block(uint32_t h[8], const uint8_t *block) {
  uint32_t w[64], v[8];
  int i;
  for (i = 0; i < 16; ++i)
    w[i] = (uint32_t)block[4 * i] << 24 | (uint32_t)block[4 * i + 1] << 16 | (uint32_t)block[4 * i + 2] << 8 |
           block[4 * i + 3];
  for (i = 16; i < 64; ++i)
    w[i] = w[i - 16] + w[i - 7] + (rotated(w[i - 15], 7) ^ rotated(w[i - 15], 18) ^ w[i - 15] >> 3) +
           (rotated(w[i - 2], 17) ^ rotated(w[i - 2], 19) ^ w[i - 2] >> 10);
  memcpy(v, h, sizeof v);
  for (i = 0; i < 64; ++i) {
    uint32_t one = v[7] + (rotated(v[4], 6) ^ rotated(v[4], 11) ^ rotated(v[4], 25)) +
                   ((v[4] & v[5]) ^ (~v[4] & v[6])) + K[i] + w[i];
    uint32_t two =
        (rotated(v[0], 2) ^ rotated(v[0], 13) ^ rotated(v[0], 22)) + ((v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]));
    memmove(v + 1, v, 7 * sizeof *v);
    v[4] += one;
    v[0] = one + two;
  }
  for (i = 0; i < 8; ++i) h[i] += v[i];
}

static void sha256(const uint8_t *data, size_t size, uint8_t digest[DIGEST]) {
  uint32_t h[8] = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  uint8_t last[128] = {0};
  size_t whole = size / 64 * 64, rest = size - whole, i, ends = rest < 56 ? 64 : 128;
  for (i = 0; i < whole; i += 64) sha256_block(h, data + i);
  memcpy(last, data + whole, rest);
  last[rest] = 0x80;
  for (i = 0; i < 8; ++i) last[ends - 1 - i] = (uint8_t)((uint64_t)size * 8 >> 8 * i);
  for (i = 0; i < ends; i += 64) sha256_block(h, last + i);
  for (i = 0; i < DIGEST; ++i) digest[i] = (uint8_t)(h[i / 4] >> (24 - 8 * (i % 4)));
}

/* ---- the blob ---- */

static unsigned u16(const uint8_t *at) { return (unsigned)at[0] | (unsigned)at[1] << 8; }
static uint32_t u32(const uint8_t *at) { return u16(at) | (uint32_t)u16(at + 2) << 16; }
static size_t aligned(size_t x) { return (x + 63) / 64 * 64; }
static int in(int x, int low, int high) { return low <= x && x <= high; }

static int32_t i32(const uint8_t *at) {
  uint32_t bits = u32(at);
  int32_t x;
  memcpy(&x, &bits, sizeof x);
  return x;
}

static int all_zero(const uint8_t *at, size_t count) {
  while (count--)
    if (*at++) return 0;
  return 1;
}

static int bit(const uint8_t *bits, size_t i) { return bits[i / 8] >> (i % 8) & 1; }

/* Fills in what follows from kernels, strides and outputs; NULL, or what is wrong. */
static const char *chain(Network *net) {
  int l, s = net->P, c = net->C;
  double signs = 0, sums = 0;
  for (l = 0; l < net->L; ++l) {
    Layer *g = &net->layers[l];
    int connected = l >= net->L - 2, last = l == net->L - 1;
    g->s = s, g->c = c;
    if (!in(g->k, 1, connected ? s : s < 16 ? s : 16)) return "a kernel is larger than its input, or than 16";
    if (!in(g->d, 1, g->k)) return "a stride is not 1 to its kernel";
    if (connected && (g->k != s || g->d != 1)) return "one of the last two layers is not fully connected";
    if (!in(g->m, last ? 2 : 1, last ? 64 : connected ? 1024 : 128)) return "outputs are out of range";
    g->t = (s - g->k) / g->d + 1;
    g->n = g->k * g->k * c;
    signs += (double)g->m * g->n;
    sums += (double)g->t * g->t * g->m * g->n;
    s = g->t, c = g->m;
  }
  return signs > 4e6 || sums > 2e8 ? "the network is too large" : NULL;
}

static const char *sections(Network *net, const uint8_t *data, size_t size, size_t at) {
  int l, j;
  size_t end = at;
  for (l = 0; l < net->L; ++l) end += aligned(4 * (size_t)net->layers[l].m * ((net->layers[l].n + 31) / 32));
  for (l = 0; l < net->L - 1; ++l) end += aligned(4 * (size_t)net->layers[l].m);
  if (size != end + DIGEST) return "its size is not what the header tells";
  for (l = 0; l < net->L; ++l) {
    Layer *g = &net->layers[l];
    size_t words = (g->n + 31) / 32, bytes = 4 * words * g->m, i;
    g->signs = data + at, g->row_bits = 32 * words;
    for (j = 0; j < g->m; ++j)
      for (i = g->n; i < 32 * words; ++i)
        if (bit(g->signs, j * g->row_bits + i)) return "a bit behind a row of signs is not 0";
    if (!all_zero(data + at + bytes, aligned(bytes) - bytes)) return "a byte behind a section is not 0";
    at += aligned(bytes);
  }
  for (l = 0; l < net->L - 1; ++l) {
    size_t bytes = 4 * (size_t)net->layers[l].m;
    net->layers[l].thresholds = data + at;
    if (!all_zero(data + at + bytes, aligned(bytes) - bytes)) return "a byte behind a section is not 0";
    at += aligned(bytes);
  }
  return NULL;
}

static const char *decode_2(Network *net, const uint8_t *data, size_t size) {
  int l, together = 0;
  size_t at, H;
  const char *wrong;
  if (size < 48) return "it is shorter than a header";
  net->C = u16(data + 6), net->P = u16(data + 8), net->L = u16(data + 10), net->D = u16(data + 12);
  if (!in(net->C, 1, 16) || !in(net->P, 8, 128)) return "channels or image size are out of range";
  if (!in(net->L, 3, MAX_LAYERS) || !in(net->D, 1, MAX_DIMS)) return "layers or dimensions are out of range";
  at = 48 + 8 * (size_t)net->L + 2 * (size_t)net->D, H = aligned(at);
  if (size < H) return "it is shorter than its header";
  if (!all_zero(data + 14, 2) || !all_zero(data + 44, 4) || !all_zero(data + at, H - at))
    return "a byte of the header is not 0 where it must be";
  memcpy(&net->lambda, &(uint32_t){u32(data + 40)}, sizeof net->lambda);
  for (l = 0; l < net->L; ++l) {
    const uint8_t *row = data + 48 + 8 * l;
    net->layers[l].k = u16(row), net->layers[l].d = u16(row + 2), net->layers[l].m = u16(row + 4);
    if (u16(row + 6)) return "a byte of the header is not 0 where it must be";
  }
  if ((wrong = chain(net))) return wrong;
  for (l = 0; l < net->D; ++l) {
    net->choices[l] = u16(data + 48 + 8 * net->L + 2 * l);
    if (net->choices[l] < 2) return "a dimension has fewer than 2 choices";
    together += net->choices[l];
  }
  if (together != net->layers[net->L - 1].m) return "the choices are not the actions";
  return sections(net, data, size, H);
}

static const char *decode_1(Network *net, const uint8_t *data, size_t size) {
  static const int paper[5][3] = {{8, 4, 8}, {4, 2, 16}, {3, 1, 16}, {7, 1, 0}, {1, 1, 0}};
  int l;
  size_t at = 40, end = 40;
  const char *wrong;
  if (size < 40) return "it is shorter than a header";
  net->C = u16(data + 6), net->P = 84, net->L = 5, net->D = 1;
  if (!in(net->C, 1, 16)) return "channels are out of range";
  memcpy(&net->lambda, &(uint32_t){u32(data + 36)}, sizeof net->lambda);
  for (l = 0; l < 5; ++l)
    net->layers[l].k = paper[l][0], net->layers[l].d = paper[l][1], net->layers[l].m = paper[l][2];
  net->layers[3].m = u16(data + 8), net->layers[4].m = net->choices[0] = u16(data + 10);
  if ((wrong = chain(net))) return wrong;
  for (l = 0; l < 5; ++l) end += ((size_t)net->layers[l].m * net->layers[l].n + 7) / 8;
  for (l = 0; l < 4; ++l) end += 4 * (size_t)net->layers[l].m;
  if (size != end + DIGEST) return "its size is not what the header tells";
  for (l = 0; l < 5; ++l) {
    Layer *g = &net->layers[l];
    size_t bits = (size_t)g->m * g->n, i;
    g->signs = data + at, g->row_bits = g->n;
    for (i = bits; i % 8; ++i)
      if (bit(g->signs, i)) return "a bit behind a layer's signs is not 0";
    at += (bits + 7) / 8;
  }
  for (l = 0; l < 4; ++l) net->layers[l].thresholds = data + at, at += 4 * (size_t)net->layers[l].m;
  return NULL;
}

/* The network points into `data`. NULL, or why the blob is refused. */
static const char *decode(Network *net, const uint8_t *data, size_t size) {
  uint8_t digest[DIGEST];
  const char *wrong;
  memset(net, 0, sizeof *net);
  if (size < 6 || memcmp(data, "BPNW", 4)) return "it does not begin with BPNW";
  net->schema = u16(data + 4);
  if (net->schema != 1 && net->schema != 2) return "its schema is neither 1 nor 2";
  if ((wrong = net->schema == 1 ? decode_1(net, data, size) : decode_2(net, data, size))) return wrong;
  if (!(net->lambda > 0 && net->lambda <= 3.402823466e38f)) return "lambda is not finite and above 0";
  sha256(data, size - DIGEST, digest);
  return memcmp(digest, data + size - DIGEST, DIGEST) ? "its digest is another one" : NULL;
}

/* ---- the network ---- */

/* o of one layer, in the order row, column, output; `input` in the order row, column, channel. */
static void layer_outputs(const Layer *g, const int32_t *input, int32_t *o) {
  int y, x, j, row, column, channel;
  for (y = 0; y < g->t; ++y)
    for (x = 0; x < g->t; ++x)
      for (j = 0; j < g->m; ++j) {
        int32_t sum = 0;
        size_t sign = j * g->row_bits;
        for (row = 0; row < g->k; ++row)
          for (column = 0; column < g->k; ++column)
            for (channel = 0; channel < g->c; ++channel) {
              int32_t value = input[((size_t)(y * g->d + row) * g->s + x * g->d + column) * g->c + channel];
              sum += bit(g->signs, sign++) ? value : -value;
            }
        *o++ = sum;
      }
}

/* Compares every layer's o for one observation; 0, or the number of the first layer that differs. */
static int compare(const Network *net, const uint8_t *observation, const uint8_t *expected) {
  int l, y, x, c, differs = 0;
  size_t i, count, P = (size_t)net->P;
  int32_t *input = malloc(sizeof *input * P * P * net->C);
  for (y = 0; y < net->P; ++y)
    for (x = 0; x < net->P; ++x)
      for (c = 0; c < net->C; ++c) input[(y * P + x) * net->C + c] = observation[(c * P + y) * P + x];
  for (l = 0; l < net->L && !differs; ++l) {
    const Layer *g = &net->layers[l];
    int32_t *o;
    count = (size_t)g->t * g->t * g->m;
    o = malloc(sizeof *o * count);
    layer_outputs(g, input, o);
    for (i = 0; i < count; ++i)
      if (o[i] != i32(expected + 4 * i)) differs = l + 1;
    expected += 4 * count;
    if (g->thresholds)
      for (i = 0; i < count; ++i) o[i] = o[i] >= i32(g->thresholds + 4 * (i % g->m)) ? 1 : -1;
    free(input);
    input = o;
  }
  free(input);
  return differs;
}

static size_t read_file(const char *path, uint8_t data[MAX_FILE]) {
  FILE *file = fopen(path, "rb");
  size_t size;
  if (!file) {
    fprintf(stderr, "%s cannot be read\n", path);
    exit(3);
  }
  size = fread(data, 1, MAX_FILE, file);
  fclose(file);
  return size;
}

int main(int argc, char **argv) {
  Network net;
  static uint8_t data[MAX_FILE], answers[MAX_FILE];
  size_t size, answers_size, record, observation;
  const char *wrong;
  int l, differs;
  uint32_t r, records;
  if (argc < 2 || argc > 3) {
    fprintf(stderr, "usage: bpn_blob BLOB [ANSWERS]\n");
    return 3;
  }
  size = read_file(argv[1], data);
  if ((wrong = decode(&net, data, size))) {
    printf("refused: %s\n", wrong);
    return 2;
  }
  printf("schema %d, %d channels of %d x %d, lambda %.9g\n", net.schema, net.C, net.P, net.P, net.lambda);
  for (l = 0; l < net.L; ++l)
    printf("layer %d: kernel %d, stride %d, %d outputs at %d x %d\n", l + 1, net.layers[l].k, net.layers[l].d,
           net.layers[l].m, net.layers[l].t, net.layers[l].t);
  if (argc < 3) return 0;

  answers_size = read_file(argv[2], answers);
  observation = (size_t)net.C * net.P * net.P, record = observation;
  for (l = 0; l < net.L; ++l) record += 4 * (size_t)net.layers[l].t * net.layers[l].t * net.layers[l].m;
  records = answers_size < 4 ? 0 : u32(answers);
  if (answers_size != 4 + records * record) {
    printf("the answers are of another network\n");
    return 1;
  }
  for (r = 0; r < records; ++r) {
    const uint8_t *at = answers + 4 + r * record;
    if ((differs = compare(&net, at, at + observation))) {
      printf("record %u differs in layer %d\n", (unsigned)r, differs);
      return 1;
    }
  }
  printf("%u records, every layer is exact\n", (unsigned)records);
  return 0;
}
