/**
 * The live hub's protocol, version 1: JSON text messages both ways, and camera frames as binary
 * messages from the server. What does not fit it is refused here, so that no other module has to doubt.
 */

export const PROTOCOL_VERSION = 1;
export const FRAME_HEADER_BYTES = 32;

export type ClientMessage =
  | { op: 'hello'; proto: number }
  | { op: 'sub'; id: number; topic: string; rate_hz?: number; since: number | null }
  | { op: 'unsub'; id: number }
  | { op: 'ack'; id: number; seq: number }
  | { op: 'ping'; t: number };

export type ServerMessage =
  | { op: 'welcome'; proto: number; server: string; now_unix_s: number }
  | { op: 'data'; id: number; seq: number; t_unix_s: number; data: unknown }
  | { op: 'gap'; id: number; missed: number | null }
  | { op: 'error'; id: number | null; title: string }
  | { op: 'pong'; t: number; now_unix_s: number };

/** One observation as the network sees it. */
export interface Frame {
  /** Subscription that it answers. */
  id: number;
  seq: number;
  /** When the robot took the newest of its frames (unix time, seconds). */
  captureUnixS: number;
  /** When the hub sent it (unix time, seconds). */
  hubUnixS: number;
  encoding: 'raw' | 'jpeg';
  /** Channels of all stacked frames together, oldest frame first. */
  channels: number;
  heightPx: number;
  widthPx: number;
  framesStacked: number;
  /** Raw: uint8[channels, height, width]; else the encoded image. */
  pixels: Uint8Array<ArrayBuffer>;
}

/** What arrived is not protocol version 1; the message names the value. */
export class ProtocolError extends Error {}

/** Reads a text message. Throws ProtocolError if a field is missing or of another type. */
export function parseServerMessage(text: string): ServerMessage {
  let message: unknown;
  try {
    message = JSON.parse(text);
  } catch {
    throw new ProtocolError(`not JSON: ${text.slice(0, 80)}`);
  }
  if (typeof message !== 'object' || message === null) {
    throw new ProtocolError(`not an object: ${text.slice(0, 80)}`);
  }
  const fields = message as Record<string, unknown>;
  const number = (name: string): number => required(fields, name, 'number') as number;
  const string = (name: string): string => required(fields, name, 'string') as string;
  switch (fields.op) {
    case 'welcome':
      return {
        op: 'welcome',
        proto: number('proto'),
        server: string('server'),
        now_unix_s: number('now_unix_s'),
      };
    case 'data':
      return {
        op: 'data',
        id: number('id'),
        seq: number('seq'),
        t_unix_s: number('t_unix_s'),
        data: fields.data,
      };
    case 'gap':
      return {
        op: 'gap',
        id: number('id'),
        missed: fields.missed === null ? null : number('missed'),
      };
    case 'error':
      return {
        op: 'error',
        id: typeof fields.id === 'number' ? fields.id : null,
        title: string('title'),
      };
    case 'pong':
      return { op: 'pong', t: number('t'), now_unix_s: number('now_unix_s') };
    default:
      throw new ProtocolError(`unknown op ${JSON.stringify(fields.op)}`);
  }
}

function required(fields: Record<string, unknown>, name: string, type: string): unknown {
  const value = fields[name];
  if (typeof value !== type) {
    throw new ProtocolError(
      `${String(fields.op)}: ${name} is ${JSON.stringify(value)}, not a ${type}`,
    );
  }
  return value;
}

/**
 * Reads a binary message: a little-endian header of 32 bytes (u8 version, u8 type, u16 subscription,
 * u32 seq, f64 capture, f64 hub, u16 channels, u16 height, u16 width, u16 frames stacked), then pixels.
 * Throws ProtocolError if it is cut, of another version, or the pixels are not of its shape.
 */
export function decodeFrame(message: ArrayBuffer): Frame {
  if (message.byteLength < FRAME_HEADER_BYTES) {
    throw new ProtocolError(`frame: ${message.byteLength} bytes are less than a header`);
  }
  const header = new DataView(message, 0, FRAME_HEADER_BYTES);
  const version = header.getUint8(0);
  if (version !== 1) throw new ProtocolError(`frame: version ${version}, this page reads 1`);
  const type = header.getUint8(1);
  if (type !== 1 && type !== 2) throw new ProtocolError(`frame: type ${type} is none of 1, 2`);
  const frame: Frame = {
    id: header.getUint16(2, true),
    seq: header.getUint32(4, true),
    captureUnixS: header.getFloat64(8, true),
    hubUnixS: header.getFloat64(16, true),
    encoding: type === 1 ? 'raw' : 'jpeg',
    channels: header.getUint16(24, true),
    heightPx: header.getUint16(26, true),
    widthPx: header.getUint16(28, true),
    framesStacked: Math.max(1, header.getUint16(30, true)),
    pixels: new Uint8Array(message, FRAME_HEADER_BYTES),
  };
  const expected = frame.channels * frame.heightPx * frame.widthPx;
  if (frame.encoding === 'raw' && frame.pixels.length !== expected) {
    throw new ProtocolError(`frame: ${frame.pixels.length} pixel bytes, its shape has ${expected}`);
  }
  if (frame.channels % frame.framesStacked !== 0) {
    throw new ProtocolError(
      `frame: ${frame.channels} channels are no ${frame.framesStacked} frames`,
    );
  }
  return frame;
}
