import { expect, test } from 'vitest';
import { decodeFrame, FRAME_HEADER_BYTES, parseServerMessage, ProtocolError } from './protocol';

function message(change: (view: DataView) => void = () => undefined, pixels = 24): ArrayBuffer {
  const buffer = new ArrayBuffer(FRAME_HEADER_BYTES + pixels);
  const view = new DataView(buffer);
  view.setUint8(0, 1);
  view.setUint8(1, 1);
  view.setUint16(2, 513, true);
  view.setUint32(4, 4_000_000_000, true);
  view.setFloat64(8, 1.25, true);
  view.setFloat64(16, 1.5, true);
  [6, 2, 2, 2].forEach((value, i) => view.setUint16(24 + 2 * i, value, true));
  new Uint8Array(buffer, FRAME_HEADER_BYTES).forEach((_, i, all) => (all[i] = i));
  change(view);
  return buffer;
}

test('every field of the header stands where the protocol says', () => {
  const { pixels, ...frame } = decodeFrame(message());
  expect(frame).toEqual({
    id: 513,
    seq: 4_000_000_000,
    captureUnixS: 1.25,
    hubUnixS: 1.5,
    encoding: 'raw',
    channels: 6,
    heightPx: 2,
    widthPx: 2,
    framesStacked: 2,
  });
  expect([...pixels]).toEqual(Array.from({ length: 24 }, (_, i) => i));
});

test.each([
  ['another version', message((view) => view.setUint8(0, 2))],
  ['an unknown type', message((view) => view.setUint8(1, 9))],
  ['too few pixels', message(undefined, 23)],
  ['channels that are no whole frames', message((view) => view.setUint16(30, 4, true))],
  ['a cut header', new ArrayBuffer(31)],
])('refuses %s', (_, data) => {
  expect(() => decodeFrame(data)).toThrow(ProtocolError);
});

test.each([
  '',
  '[]',
  '"text"',
  'null',
  '{"op":"shout"}',
  '{"op":"gap","id":1}',
  '{"op":"welcome"}',
])('refuses %s', (text) => {
  expect(() => parseServerMessage(text)).toThrow(ProtocolError);
});
