/** The WebSocket to the server: keeps only the newest frame, matches answers to requests, and reconnects. */

import type { Message } from './protocol';

export type Line = 'connecting' | 'open' | 'reconnecting' | 'refused';

const FIRST_WAIT = 250; // ms
const LONGEST_WAIT = 5000;
const SOON = 500;
const SILENCE = 8000; // ms without any message after which the connection counts as lost
const PING = 2000;
const BACKLOG = 4096; // unsent bytes above which a drag is omitted in favour of the next one

export interface Answer {
  ok: boolean;
  code: string;
  message: string;
}

export class Connection {
  line: Line = 'connecting';
  /** Round-trip time in ms; NaN before the first answer. */
  roundTrip = NaN;
  frames = 0;
  reconnects = 0;
  onMessage: (message: Message) => void = () => undefined;
  onLine: (line: Line) => void = () => undefined;
  /** Called after a frame has arrived, which `take` returns. */
  onFrame: () => void = () => undefined;

  private socket: WebSocket | null = null;
  private newest: ArrayBuffer | null = null;
  private wait = FIRST_WAIT;
  private heard = 0;
  private number = 0;
  private waiting = new Map<number, (answer: Answer) => void>();
  private opened = false;
  /** Secret with which this page reconnects as the same client and keeps its grabs. */
  private resume = '';
  /** Whether the server comes back soon, so that the page asks often. */
  hurries = false;

  constructor(private readonly url: string) {
    setInterval(() => this.watch(), PING);
  }

  open(): void {
    const socket = new WebSocket(this.resume ? `${this.url}?resume=${encodeURIComponent(this.resume)}` : this.url);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    this.heard = performance.now();
    socket.onopen = () => {
      this.opened = true;
      this.wait = FIRST_WAIT;
      this.say('open');
    };
    socket.onmessage = (event: MessageEvent<ArrayBuffer | string>) => {
      this.heard = performance.now();
      if (typeof event.data !== 'string') {
        this.newest = event.data;
        this.frames++;
        this.onFrame();
      } else this.hear(JSON.parse(event.data) as Message);
    };
    socket.onclose = () => {
      if (this.socket === socket) this.lost();
    };
  }

  /** Return the newest frame, once; null if there is no new frame. */
  take(): ArrayBuffer | null {
    const frame = this.newest;
    this.newest = null;
    return frame;
  }

  /** Send a request; the promise resolves to its result and is never rejected. */
  ask(type: string, fields: object = {}): Promise<Answer> {
    if (this.socket?.readyState !== WebSocket.OPEN)
      return Promise.resolve({ ok: false, code: 'offline', message: 'There is no connection to the server.' });
    const id = ++this.number;
    this.socket.send(JSON.stringify({ type, id, ...fields }));
    return new Promise((resolve) => this.waiting.set(id, resolve));
  }

  /** Send a message that a later one of its type replaces; return false if it was omitted, because too much is unsent. */
  tell(type: string, fields: object): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN || this.socket.bufferedAmount > BACKLOG) return false;
    this.socket.send(JSON.stringify({ type, ...fields }));
    return true;
  }

  /** Close the connection, as a bad network would; the page reconnects. For tests. */
  drop(): void {
    this.socket?.close();
  }

  private hear(message: Message): void {
    if (message.type === 'hello') this.resume = message.resume ?? '';
    if (message.type === 'pong') this.roundTrip = performance.now() - message.t;
    if ((message.type === 'ack' || message.type === 'error') && message.id !== undefined) {
      const resolve = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (message.type === 'ack') resolve?.({ ok: true, code: '', message: '' });
      else resolve?.({ ok: false, code: message.code, message: message.message });
    }
    this.onMessage(message);
  }

  private watch(): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (performance.now() - this.heard > SILENCE) {
      const dead = this.socket;
      this.lost();
      dead.close();
    } else this.tell('ping', { t: performance.now() });
  }

  private lost(): void {
    this.socket = null;
    for (const resolve of this.waiting.values())
      resolve({ ok: false, code: 'offline', message: 'The connection to the server was lost.' });
    this.waiting.clear();
    this.reconnects++;
    this.say('reconnecting');
    if (!this.opened) void this.admitted();
    const wait = this.wait * (0.8 + 0.4 * Math.random()); // so that many clients do not reconnect at the same time
    setTimeout(() => this.open(), wait);
    this.wait = Math.min(2 * this.wait, this.hurries ? SOON : LONGEST_WAIT);
  }

  /** A WebSocket does not report why it was refused: request a file with the same access rules. */
  private async admitted(): Promise<void> {
    try {
      const status = (await fetch('scene.json', { cache: 'no-store' })).status;
      if ((status === 401 || status === 403) && this.line !== 'open') this.say('refused');
    } catch {
      // the server is not reachable, which `line` already states
    }
  }

  private say(line: Line): void {
    if (this.line === line) return;
    this.line = line;
    this.onLine(line);
  }
}
