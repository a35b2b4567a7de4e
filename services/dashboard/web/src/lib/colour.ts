/** Colours of lines: the same for the same group wherever and whenever it is shown, told apart by colour-blind people. */

import { Value } from './observable';

/**
 * Okabe and Ito's hues, with a lightness per theme that keeps 3:1 against the chart's background. Their yellow
 * is one only on dark ground, their black only on light: they share a place. The last is a grey.
 */
export const PALETTE = {
  light: ['#0072b2', '#cc5200', '#00805e', '#b0588a', '#b07a00', '#3b93cc', '#1a1c1f', '#868b92'],
  dark: ['#4aa8e0', '#f0803c', '#22b88e', '#dd96bd', '#e8ab2e', '#8accf5', '#f0e442', '#a8adb5'],
} as const;

/** What the colours are called, in the palette's order. */
const SHARED_NAMES = ['blue', 'orange', 'green', 'pink', 'ochre', 'sky blue'] as const;
export const COLOUR_NAMES = {
  light: [...SHARED_NAMES, 'black', 'grey'],
  dark: [...SHARED_NAMES, 'yellow', 'grey'],
} as const;

export const DASHES: readonly (readonly number[])[] = [[], [8, 4], [2, 3], [10, 3, 2, 3]];
const COLOURS = PALETTE.light.length;
/** The order in which colours are given: last those that a thin line hardly tells from another, and grey. */
const ORDER = [0, 1, 2, 3, 6, 4, 5, 7] as const;
const HUES = 5; // blue, orange, green, pink, black or yellow
const SLOTS = COLOURS * DASHES.length;

export type ThemeName = keyof typeof PALETTE;

export interface Stroke {
  colour: number; // index into the palette
  dash: readonly number[];
}

/** 32-bit FNV-1a hash of a text. */
export function hash(text: string): number {
  let value = 0x811c9dc5;
  for (let i = 0; i < text.length; i++) {
    value = Math.imul(value ^ text.charCodeAt(i), 0x01000193);
  }
  return value >>> 0;
}

/** A store of strings, as `localStorage` is one. */
export type KeyStorage = Pick<Storage, 'getItem' | 'setItem'>;

const KEPT = 400;

/**
 * Which stroke a key has. Its hash says which one it prefers; another one is taken when that colour is in use by
 * something shown beside it. What was given is kept, so that filtering changes no colour.
 */
export class StrokeBook {
  readonly #slots: Map<string, number>;
  /** Grows when somebody has chosen a colour. */
  readonly choices = new Value(0);

  constructor(
    private readonly storage: KeyStorage | null = null,
    private readonly name = 'bpn.strokes',
  ) {
    this.#slots = new Map(readPairs(storage?.getItem(name)));
  }

  /** Strokes for keys that are shown together. */
  assign(keys: readonly string[]): Map<string, Stroke> {
    const given = new Map<string, number>();
    const used = new Set<number>();
    const wanting = [...new Set(keys)].sort();
    for (const key of wanting) {
      const slot = this.#slots.get(key);
      if (slot === undefined || used.has(slot)) continue;
      given.set(key, slot);
      used.add(slot);
    }
    for (const key of wanting) {
      if (given.has(key)) continue;
      const slot = freeSlot(hash(key) % HUES, used);
      given.set(key, slot);
      used.add(slot);
      this.#slots.set(key, slot);
    }
    this.#keep();
    return new Map(keys.map((key) => [key, strokeOf(given.get(key) ?? 0)]));
  }

  /** The reader's own choice, of a solid line. Of those shown beside it, the one that had it takes its stroke. */
  choose(key: string, colour: number, shown: readonly string[] = []): void {
    const before = this.#slots.get(key);
    const other = shown.find((one) => one !== key && this.#slots.get(one) === colour);
    if (other !== undefined && before !== undefined) this.#slots.set(other, before);
    this.#slots.set(key, colour % COLOURS);
    this.#keep();
    this.choices.update((count) => count + 1);
  }

  #keep(): void {
    const newest = [...this.#slots].slice(-KEPT);
    this.storage?.setItem(this.name, JSON.stringify(newest));
  }
}

/** The first free slot from a hue on: all colours of one dash pattern before the next pattern. */
function freeSlot(hue: number, used: Set<number>): number {
  const hues = ORDER.slice(0, HUES);
  const order = [...hues.slice(hue), ...hues.slice(0, hue), ...ORDER.slice(HUES)];
  for (let dash = 0; dash < DASHES.length; dash++) {
    for (const colour of order) {
      const slot = dash * COLOURS + colour;
      if (!used.has(slot)) return slot;
    }
  }
  return order[0] ?? 0;
}

function strokeOf(slot: number): Stroke {
  return { colour: slot % COLOURS, dash: DASHES[Math.floor(slot / COLOURS)] ?? [] };
}

function readPairs(text: string | null | undefined): [string, number][] {
  try {
    const pairs: unknown = JSON.parse(text ?? '[]');
    return Array.isArray(pairs) ? pairs.filter(isPair) : [];
  } catch {
    return [];
  }
}

function isPair(item: unknown): item is [string, number] {
  return (
    Array.isArray(item) &&
    typeof item[0] === 'string' &&
    Number.isInteger(item[1]) &&
    item[1] >= 0 &&
    item[1] < SLOTS
  );
}

/** `#rrggbb` with an opacity of 0 to 1. */
export function withAlpha(colour: string, alpha: number): string {
  return (
    colour +
    Math.round(alpha * 255)
      .toString(16)
      .padStart(2, '0')
  );
}

/** Contrast of two `#rrggbb` colours by WCAG 2, 1 to 21. */
export function contrast(one: string, other: string): number {
  const [high = 1, low = 1] = [luminance(one), luminance(other)].sort((a, b) => b - a);
  return (high + 0.05) / (low + 0.05);
}

function luminance(colour: string): number {
  const [r = 0, g = 0, b = 0] = [1, 3, 5].map((at) => {
    const share = parseInt(colour.slice(at, at + 2), 16) / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** A colour between stops, for t in 0..1, mixed linearly in sRGB. */
export function ramp(stops: readonly string[], t: number): string {
  const at = Math.min(Math.max(t, 0), 1) * (stops.length - 1);
  const index = Math.min(Math.floor(at), stops.length - 2);
  const [low = '#000000', high = '#000000'] = [stops[index], stops[index + 1]];
  const channels = [1, 3, 5].map((place) => {
    const [a, b] = [
      parseInt(low.slice(place, place + 2), 16),
      parseInt(high.slice(place, place + 2), 16),
    ];
    return Math.round(a + (b - a) * (at - index))
      .toString(16)
      .padStart(2, '0');
  });
  return `#${channels.join('')}`;
}
