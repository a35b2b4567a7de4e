/**
 * One WebSocket for the whole tab. Subscriptions outlive connections: after a loss the client comes back by
 * itself, asks for every topic again from where it was, and says so where something is missing.
 */

import { backoffS } from './backoff';
import { ServerClock } from './clock';
import {
  decodeFrame,
  parseServerMessage,
  PROTOCOL_VERSION,
  ProtocolError,
  type ClientMessage,
  type Frame,
  type ServerMessage,
} from './protocol';

export type ConnectionState = 'connecting' | 'online' | 'offline' | 'unauthorized';

export interface ConnectionStatus {
  state: ConnectionState;
  /** When the connection was lost (local clock, ms); null while online. */
  lostAtMs: number | null;
  /** When the next attempt comes (local clock, ms); null if none is planned. */
  retryAtMs: number | null;
  /** Round trip of the last ping in ms; null before the first. */
  roundTripMs: number | null;
}

export interface TopicHandlers {
  /** At most so many messages a second; the hub leaves out older ones. */
  rateHz?: number;
  /** Sequence number after which to begin; 0: with all that the hub still holds; null: with what comes. */
  since?: number | null;
  onData?(data: unknown, seq: number, serverUnixS: number): void;
  /** `done` tells the hub that the frame was drawn or dropped: it sends at most two ahead. */
  onFrame?(frame: Frame, done: () => void): void;
  /** Messages are missing; null: nobody knows how many, because the server was restarted. */
  onGap?(missed: number | null): void;
  onError?(title: string): void;
}

export interface LiveStatistics {
  messages: number;
  frames: number;
  gaps: number;
  connections: number;
  /** Messages that were not understood. */
  refused: number;
}

/** The WebSocket's close code for a session that is missing or has expired. */
const CLOSE_UNAUTHORIZED = 4401;
const PING_EVERY_MS = 10_000;
const MAX_SUBSCRIPTIONS = 0xffff;

interface Topic extends TopicHandlers {
  topic: string;
  lastSeq: number | null;
}

export interface LiveClientOptions {
  /** Makes a socket; tests bring another implementation. */
  open?: (url: string) => WebSocket;
  /** Seconds until the n-th reconnection in a row. */
  backoffS?: (attempt: number) => number;
  onStatus?: (status: ConnectionStatus) => void;
  /** What the server sent was not understood; the page goes on. */
  onRefused?: (error: ProtocolError) => void;
}

export class LiveClient {
  readonly clock = new ServerClock();
  readonly statistics: LiveStatistics = {
    messages: 0,
    frames: 0,
    gaps: 0,
    connections: 0,
    refused: 0,
  };
  private readonly topics = new Map<number, Topic>();
  private socket: WebSocket | null = null;
  private server: string | null = null;
  private attempt = 0;
  private nextId = 1;
  private retryTimer: ReturnType<typeof setTimeout> | undefined;
  private pingTimer: ReturnType<typeof setInterval> | undefined;
  private answeredSincePing = true;
  private closed = false;
  private current: ConnectionStatus = {
    state: 'connecting',
    lostAtMs: null,
    retryAtMs: null,
    roundTripMs: null,
  };

  constructor(
    private readonly url: string,
    private readonly options: LiveClientOptions = {},
  ) {}

  get status(): ConnectionStatus {
    return this.current;
  }

  /** Connects, now; also the answer to "retry now". */
  connect(): void {
    if (this.socket !== null || this.closed) return;
    clearTimeout(this.retryTimer);
    this.report({ state: 'connecting', retryAtMs: null });
    const socket = (this.options.open ?? ((url) => new WebSocket(url)))(this.url);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => this.send({ op: 'hello', proto: PROTOCOL_VERSION });
    socket.onmessage = (event: MessageEvent<unknown>) => {
      if (this.socket === socket) this.receive(event.data);
    };
    socket.onclose = (event) => {
      if (this.socket === socket) this.lost(event.code);
    };
    this.socket = socket;
    this.answeredSincePing = true;
    this.pingTimer = setInterval(() => this.ping(), PING_EVERY_MS);
  }

  /** Ends for good. */
  close(): void {
    this.closed = true;
    clearTimeout(this.retryTimer);
    clearInterval(this.pingTimer);
    this.socket?.close();
    this.socket = null;
  }

  /** Asks for a topic until the returned function is called. */
  subscribe(topic: string, handlers: TopicHandlers): () => void {
    const id = this.freeId();
    this.topics.set(id, { ...handlers, topic, lastSeq: handlers.since ?? null });
    if (this.current.state === 'online') this.sendSubscription(id);
    return () => {
      if (this.topics.delete(id) && this.current.state === 'online') {
        this.send({ op: 'unsub', id });
      }
    };
  }

  private freeId(): number {
    if (this.topics.size >= MAX_SUBSCRIPTIONS) throw new Error('too many subscriptions');
    while (this.topics.has(this.nextId)) this.advanceId();
    const id = this.nextId;
    this.advanceId(); // not used again at once: answers to the old subscription may be on their way
    return id;
  }

  private advanceId(): void {
    this.nextId = (this.nextId % MAX_SUBSCRIPTIONS) + 1;
  }

  private sendSubscription(id: number): void {
    const topic = this.topics.get(id);
    if (topic === undefined) return;
    this.send({
      op: 'sub',
      id,
      topic: topic.topic,
      since: topic.lastSeq,
      ...(topic.rateHz === undefined ? {} : { rate_hz: topic.rateHz }),
    });
  }

  private send(message: ClientMessage): void {
    const { socket } = this;
    if (socket !== null && socket.readyState === socket.OPEN) socket.send(JSON.stringify(message));
  }

  private receive(data: unknown): void {
    this.answeredSincePing = true;
    this.statistics.messages += 1;
    try {
      if (data instanceof ArrayBuffer) this.onFrame(decodeFrame(data));
      else this.onMessage(parseServerMessage(String(data)));
    } catch (error) {
      if (!(error instanceof ProtocolError)) throw error;
      this.statistics.refused += 1;
      this.options.onRefused?.(error);
    }
  }

  private onFrame(frame: Frame): void {
    this.clock.observe(frame.hubUnixS);
    const topic = this.topics.get(frame.id);
    if (topic === undefined) return; // unsubscribed while it was on its way
    this.statistics.frames += 1;
    const done = () => this.send({ op: 'ack', id: frame.id, seq: frame.seq });
    if (topic.onFrame === undefined) done();
    else topic.onFrame(frame, done);
  }

  private onMessage(message: ServerMessage): void {
    switch (message.op) {
      case 'welcome':
        this.clock.observe(message.now_unix_s);
        this.welcome(message.server);
        break;
      case 'data': {
        this.clock.observe(message.t_unix_s);
        const topic = this.topics.get(message.id);
        if (topic === undefined) break;
        topic.lastSeq = message.seq;
        topic.onData?.(message.data, message.seq, message.t_unix_s);
        break;
      }
      case 'gap':
        this.gap(this.topics.get(message.id), message.missed);
        break;
      case 'error':
        if (message.id !== null) this.topics.get(message.id)?.onError?.(message.title);
        break;
      case 'pong':
        this.clock.observe(message.now_unix_s);
        this.report({ roundTripMs: performance.now() - message.t });
        break;
    }
  }

  private welcome(server: string): void {
    const restarted = this.server !== null && this.server !== server;
    this.server = server;
    this.attempt = 0;
    this.statistics.connections += 1;
    this.report({ state: 'online', lostAtMs: null, retryAtMs: null });
    for (const [id, topic] of this.topics) {
      if (restarted) {
        topic.lastSeq = null; // the new process counts from its own beginning
        this.gap(topic, null);
      }
      this.sendSubscription(id);
    }
    this.ping();
  }

  private gap(topic: Topic | undefined, missed: number | null): void {
    this.statistics.gaps += 1;
    topic?.onGap?.(missed);
  }

  private ping(): void {
    if (!this.answeredSincePing) {
      this.socket?.close(); // the other end went without saying so
      this.lost(undefined);
      return;
    }
    if (this.current.state !== 'online') return;
    this.answeredSincePing = false;
    this.send({ op: 'ping', t: performance.now() });
  }

  private lost(code: number | undefined): void {
    this.socket = null;
    clearInterval(this.pingTimer);
    if (this.closed) return;
    const lostAtMs = this.current.lostAtMs ?? Date.now();
    if (code === CLOSE_UNAUTHORIZED) {
      this.report({ state: 'unauthorized', lostAtMs, retryAtMs: null });
      return;
    }
    const delayMs = 1000 * (this.options.backoffS ?? backoffS)(this.attempt);
    this.attempt += 1;
    this.retryTimer = setTimeout(() => this.connect(), delayMs);
    this.report({ state: 'offline', lostAtMs, retryAtMs: Date.now() + delayMs });
  }

  private report(change: Partial<ConnectionStatus>): void {
    this.current = { ...this.current, ...change };
    this.options.onStatus?.(this.current);
  }
}
