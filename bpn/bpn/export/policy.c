/* A binarized policy: from the pixels of an observation to the outputs of every action, in integers alone.
 *
@ABOUT@
 *
 *     void bpn_infer(const uint8_t observation[BPN_CHANNELS * BPN_ROWS * BPN_COLUMNS], int32_t outputs[BPN_ACTIONS]);
 *     int bpn_best(const int32_t outputs[BPN_ACTIONS], int dimension);
 *
 * The greedy action is bpn_best(outputs, 0); of an action of several dimensions it is the best choice of each of them,
 * whose outputs stand side by side. P(s, a) is bpn_scale * outputs[a]. One inference at a time: the activations are
 * in static memory. Nothing is allocated.
 */
#include <stdint.h>

/*@SIZES@*/

void bpn_infer(const uint8_t *observation, int32_t *outputs);
int bpn_best(const int32_t *outputs, int dimension);
extern const char *const bpn_action_names[BPN_ACTIONS];
extern const float bpn_scale;

#ifdef BPN_TRACE /* for tests: is told every sum of every layer, in the order row, column, output */
void bpn_trace(int layer, int32_t sum);
#define BPN_TELL(layer, sum) bpn_trace((layer), (sum))
#else
#define BPN_TELL(layer, sum) ((void)(layer))
#endif

const float bpn_scale = /*@SCALE@*/;

const char *const bpn_action_names[BPN_ACTIONS] = {
/*@ACTIONS@*/
};

/* Bit 1 is +1, least significant bit first; a row for each output, in the order kernel row, kernel column, input
 * channel, padded with zeros to whole words. */
/*@WEIGHTS@*/

/* Of each dimension of an action. */
static const int bpn_choices[BPN_DIMENSIONS] = {
/*@CHOICES@*/
};

typedef struct {
    int32_t in_size, in_channels, kernel, stride, out_channels, out_size, fan_in, words;
    const uint32_t *signs;
    const int32_t *thresholds; /* an output is +1 if its sum is at least that; null of the last layer */
} bpn_layer;

static const bpn_layer bpn_layers[BPN_LAYERS] = {
/*@LAYERS@*/
};

/* Activations of two layers, one bit each, in the order row, column, channel. */
static uint32_t bpn_maps[2][BPN_MOST_MAP_WORDS];

static int32_t bits_set(uint32_t word) {
    word -= (word >> 1) & 0x55555555u;
    word = (word & 0x33333333u) + ((word >> 2) & 0x33333333u);
    word = (word + (word >> 4)) & 0x0f0f0f0fu;
    return (int32_t)((word * 0x01010101u) >> 24);
}

static void clear(uint32_t *words, int32_t count) {
    int32_t i;
    for (i = 0; i < count; ++i) words[i] = 0;
}

/* Adds `count` bits of `from`, beginning with bit `at`, to the zeros of `to` from bit `to_at` on. */
static void copy_bits(const uint32_t *from, int32_t at, int32_t count, uint32_t *to, int32_t to_at) {
    while (count > 0) {
        const int32_t room = 32 - (to_at & 31), shift = at & 31;
        const int32_t take = count < room ? count : room;
        uint32_t word = from[at >> 5] >> shift;
        if (take > 32 - shift) word |= from[(at >> 5) + 1] << (32 - shift);
        if (take < 32) word &= ((uint32_t)1 << take) - 1u;
        to[to_at >> 5] |= word << (to_at & 31);
        at += take;
        to_at += take;
        count -= take;
    }
}

static int32_t sum_of_pixels(const bpn_layer *layer, const uint8_t *patch, const uint32_t *signs) {
    int32_t i, sum = 0;
    for (i = 0; i < layer->fan_in; ++i) {
        const int32_t pixel = patch[i];
        sum += (signs[i >> 5] >> (i & 31)) & 1u ? pixel : -pixel;
    }
    return sum;
}

static int32_t sum_of_signs(const bpn_layer *layer, const uint32_t *patch, const uint32_t *signs) {
    int32_t word, differing = 0;
    for (word = 0; word < layer->words; ++word) differing += bits_set(patch[word] ^ signs[word]);
    return layer->fan_in - 2 * differing;
}

static void gather_pixels(const bpn_layer *layer, const uint8_t *pixels, int32_t row, int32_t column,
                          uint8_t *patch) {
    int32_t y, x, channel;
    for (y = row; y < row + layer->kernel; ++y)
        for (x = column; x < column + layer->kernel; ++x)
            for (channel = 0; channel < layer->in_channels; ++channel)
                *patch++ = pixels[(channel * layer->in_size + y) * layer->in_size + x];
}

static void gather_signs(const bpn_layer *layer, const uint32_t *map, int32_t row, int32_t column,
                         uint32_t *patch) {
    const int32_t run = layer->kernel * layer->in_channels;
    int32_t y;
    clear(patch, layer->words);
    for (y = 0; y < layer->kernel; ++y)
        copy_bits(map, ((row + y) * layer->in_size + column) * layer->in_channels, run, patch, y * run);
}

void bpn_infer(const uint8_t *observation, int32_t *outputs) {
    static uint8_t pixels[BPN_MOST_PIXELS];
    static uint32_t signs[BPN_MOST_PATCH_WORDS];
    int32_t index, row, column, output;
    for (index = 0; index < BPN_LAYERS; ++index) {
        const bpn_layer *layer = &bpn_layers[index];
        const uint32_t *in = bpn_maps[(index + 1) % 2];
        uint32_t *out = bpn_maps[index % 2];
        int32_t bit = 0;
        clear(out, BPN_MOST_MAP_WORDS);
        for (row = 0; row < layer->out_size; ++row) {
            for (column = 0; column < layer->out_size; ++column) {
                const int32_t y = row * layer->stride, x = column * layer->stride;
                if (index == 0) {
                    gather_pixels(layer, observation, y, x, pixels);
                } else {
                    gather_signs(layer, in, y, x, signs);
                }
                for (output = 0; output < layer->out_channels; ++output, ++bit) {
                    const uint32_t *weights = layer->signs + output * layer->words;
                    const int32_t sum = index == 0 ? sum_of_pixels(layer, pixels, weights)
                                                   : sum_of_signs(layer, signs, weights);
                    BPN_TELL(index, sum);
                    if (!layer->thresholds) {
                        outputs[output] = sum;
                    } else if (sum >= layer->thresholds[output]) {
                        out[bit >> 5] |= (uint32_t)1 << (bit & 31);
                    }
                }
            }
        }
    }
}

int bpn_best(const int32_t *outputs, int dimension) {
    int before, choice, best = 0;
    for (before = 0; before < dimension; ++before) outputs += bpn_choices[before];
    for (choice = 1; choice < bpn_choices[dimension]; ++choice)
        if (outputs[choice] > outputs[best]) best = choice;
    return best;
}
