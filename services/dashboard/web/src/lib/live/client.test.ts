import { afterEach, expect, test, vi } from 'vitest';
import { WebSocket as NodeWebSocket, WebSocketServer } from 'ws';
import { LiveClient, type LiveClientOptions } from './client';
import { FRAME_HEADER_BYTES, type ClientMessage } from './protocol';

/** Long, because only what is broken waits so long, on a machine that may be busy. */
const until = (holds: () => void) => vi.waitFor(holds, { timeout: 4000 });

/** A hub of this test's making at the other end of a real WebSocket. */
class Hub {
  readonly received: ClientMessage[] = [];
  sockets: NodeWebSocket[] = [];

  private constructor(
    private readonly server: WebSocketServer,
    readonly port: number,
    private readonly name: string,
  ) {
    server.on('connection', (socket) => {
      this.sockets.push(socket);
      socket.on('message', (data: Buffer) => {
        const message = JSON.parse(data.toString()) as ClientMessage;
        this.received.push(message);
        if (message.op === 'hello') {
          this.send({ op: 'welcome', proto: 1, server: this.name, now_unix_s: 5 });
        }
        if (message.op === 'ping') {
          this.send({ op: 'pong', t: message.t, now_unix_s: 5 });
        }
      });
    });
  }

  static async open(name = 'first', port = 0): Promise<Hub> {
    const server = new WebSocketServer({ port, host: '127.0.0.1' });
    await new Promise((resolve) => server.once('listening', resolve));
    return new Hub(server, (server.address() as { port: number }).port, name);
  }

  send(message: unknown): void {
    this.sockets.at(-1)!.send(JSON.stringify(message));
  }

  sendFrame(id: number, seq: number): void {
    const message = Buffer.alloc(FRAME_HEADER_BYTES + 4);
    message.writeUInt8(1, 0);
    message.writeUInt8(1, 1);
    message.writeUInt16LE(id, 2);
    message.writeUInt32LE(seq, 4);
    [1, 2, 2, 1].forEach((value, i) => message.writeUInt16LE(value, 24 + 2 * i));
    this.sockets.at(-1)!.send(message);
  }

  subscriptions(): ClientMessage[] {
    return this.received.filter((message) => message.op === 'sub');
  }

  close(code?: number): Promise<void> {
    for (const socket of this.sockets) {
      if (code === undefined) socket.terminate();
      else socket.close(code);
    }
    return new Promise((resolve) => this.server.close(() => resolve()));
  }
}

const opened: { close(): unknown }[] = [];
afterEach(async () => {
  await Promise.all(opened.splice(0).map((each) => each.close()));
});

async function hub(name?: string, port?: number): Promise<Hub> {
  const made = await Hub.open(name, port);
  opened.push(made);
  return made;
}

/** A browser says nothing of a failed connection but its end. */
function browserLike(url: string): WebSocket {
  const socket = new NodeWebSocket(url);
  socket.on('error', () => undefined);
  return socket as unknown as WebSocket;
}

function client(port: number, options: LiveClientOptions = {}): LiveClient {
  const made = new LiveClient(`ws://127.0.0.1:${port}/`, {
    open: browserLike,
    backoffS: () => 0.01,
    ...options,
  });
  opened.push(made);
  made.connect();
  return made;
}

const online = (live: LiveClient) => until(() => expect(live.status.state).toBe('online'));

test('what was subscribed before the connection stands is asked for after the welcome', async () => {
  const server = await hub();
  const live = client(server.port);
  const data: unknown[] = [];
  live.subscribe('metrics/r', { since: 7, onData: (value) => data.push(value) });
  await until(() => expect(server.subscriptions()).toHaveLength(1));
  expect(server.received[0]).toEqual({ op: 'hello', proto: 1 });
  expect(server.subscriptions()[0]).toEqual({ op: 'sub', id: 1, topic: 'metrics/r', since: 7 });
  server.send({ op: 'data', id: 1, seq: 8, t_unix_s: 1, data: { points: [] } });
  await until(() => expect(data).toEqual([{ points: [] }]));
});

test('after a lost connection every topic goes on from where it was', async () => {
  const server = await hub();
  const live = client(server.port);
  const gaps: (number | null)[] = [];
  live.subscribe('metrics/r', { onGap: (missed) => gaps.push(missed) });
  await online(live);
  server.send({ op: 'data', id: 1, seq: 41, t_unix_s: 1, data: null });
  server.sockets[0]!.terminate();
  await until(() => expect(server.subscriptions()).toHaveLength(2));
  expect(server.subscriptions()[1]).toMatchObject({ topic: 'metrics/r', since: 41 });
  expect(gaps).toEqual([]);
});

test('a restarted server counts anew, and the subscriber is told that it may have missed something', async () => {
  const first = await hub('first');
  const live = client(first.port);
  const gaps: (number | null)[] = [];
  live.subscribe('logs/r', { onGap: (missed) => gaps.push(missed) });
  await online(live);
  first.send({ op: 'data', id: 1, seq: 41, t_unix_s: 1, data: null });
  await until(() => expect(live.statistics.messages).toBeGreaterThan(1));
  await first.close();
  await until(() => expect(live.status.lostAtMs).not.toBeNull());
  const second = await hub('second', first.port);
  await until(() => expect(second.subscriptions()).toHaveLength(1));
  expect(second.subscriptions()[0]).toMatchObject({ topic: 'logs/r', since: null });
  expect(gaps).toEqual([null]);
  expect(live.status).toMatchObject({ state: 'online', lostAtMs: null });
});

test('frames are acknowledged when they are done with, and unsubscribing stops them', async () => {
  const server = await hub();
  const live = client(server.port);
  const finish: (() => void)[] = [];
  const unsubscribe = live.subscribe('camera/r/0', {
    rateHz: 5,
    onFrame: (_frame, done) => finish.push(done),
  });
  await online(live);
  expect(server.subscriptions()[0]).toMatchObject({ rate_hz: 5 });
  server.sendFrame(1, 3);
  await until(() => expect(finish).toHaveLength(1));
  expect(server.received.some((message) => message.op === 'ack')).toBe(false);
  finish[0]!();
  await until(() => expect(server.received).toContainEqual({ op: 'ack', id: 1, seq: 3 }));
  unsubscribe();
  await until(() => expect(server.received).toContainEqual({ op: 'unsub', id: 1 }));
  server.sendFrame(1, 4);
  server.send({ op: 'gap', id: 1, missed: 2 });
  await until(() => expect(live.statistics.gaps).toBe(1));
  expect(finish).toHaveLength(1);
});

test('a session that is no longer valid ends the attempts', async () => {
  const server = await hub();
  const live = client(server.port);
  await online(live);
  await server.close(4401);
  await until(() => expect(live.status.state).toBe('unauthorized'));
  expect(live.status.retryAtMs).toBeNull();
});

test('what is not understood is counted and the connection goes on', async () => {
  const server = await hub();
  const refused: string[] = [];
  const live = client(server.port, { onRefused: (error) => refused.push(error.message) });
  await online(live);
  server.send({ op: 'data', id: 'one' });
  server.sockets[0]!.send(Buffer.from([1, 2, 3]));
  await until(() => expect(refused).toHaveLength(2));
  expect(refused[0]).toContain('id is "one"');
  expect(live.status.state).toBe('online');
});

test('the round trip is measured', async () => {
  const server = await hub();
  const live = client(server.port);
  await until(() => expect(live.status.roundTripMs).toBeGreaterThanOrEqual(0));
});

test('errors of a topic reach its subscriber alone', async () => {
  const server = await hub();
  const live = client(server.port);
  const errors: string[] = [];
  live.subscribe('camera/nobody/0', { onError: (title) => errors.push(title) });
  live.subscribe('topology', { onError: () => errors.push('wrong one') });
  await online(live);
  server.send({ op: 'error', id: 1, title: 'no such run' });
  await until(() => expect(errors).toEqual(['no such run']));
});
