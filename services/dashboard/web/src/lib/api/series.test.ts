import { expect, test } from 'vitest';
import { Problem } from './problem';
import { decodeSeries } from './series';

const COLUMNS = ['x', 'n', 'value', 'low', 'high', 'min', 'max', 'last'];

function encode(header: object, columns: number[][]): ArrayBuffer {
  let text = new TextEncoder().encode(JSON.stringify(header));
  const padded = new Uint8Array(text.length + ((4 - (text.length % 4)) % 4)).fill(0x20);
  padded.set(text);
  text = padded;
  const floats = Float32Array.from(columns.flat());
  const message = new Uint8Array(4 + text.length + floats.byteLength);
  new DataView(message.buffer).setUint32(0, text.length, true);
  message.set(text, 4);
  message.set(new Uint8Array(floats.buffer), 4 + text.length);
  return message.buffer;
}

const described = {
  metric: 'loss',
  key: 'k',
  label: '',
  group: {},
  run_ids: ['r'],
  seeds: 1,
  n_points: 2,
  bucket: 0,
};

test('columns come back in their place, NaN as missing', () => {
  const header = { series: [{ ...described, length: 2 }], columns: COLUMNS, seq: 7, groups: 9 };
  const columns = COLUMNS.map((_, i) => [i, i === 2 ? NaN : i + 0.5]);
  const { series, seq, groups } = decodeSeries(encode(header, columns));
  expect([seq, groups]).toEqual([7, 9]);
  expect(series[0]).toMatchObject({
    metric: 'loss',
    x: [0, 0.5],
    value: [2, null],
    last: [7, 7.5],
  });
  expect(series[0]).not.toHaveProperty('length');
});

test('what is cut or of another form is refused', () => {
  const whole = encode(
    { series: [{ ...described, length: 1 }], columns: COLUMNS, seq: 1 },
    COLUMNS.map(() => [1]),
  );
  for (const bytes of [0, 3, 20, whole.byteLength - 4]) {
    expect(() => decodeSeries(whole.slice(0, bytes))).toThrow(Problem);
  }
  expect(() => decodeSeries(encode({ series: [], columns: ['x'], seq: 1 }, []))).toThrow(Problem);
  expect(() => decodeSeries(encode({ series: [], columns: COLUMNS, seq: 1 }, [[1]]))).toThrow(
    Problem,
  );
});
