// The WebSocket: it comes back by itself, and says when it is gone.

import { slept_ms } from "../state/elapsed";
import type { Message } from "./contract";

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5_000;
/** The service pings; a connection that is silent for longer is a dead one that nobody closed. */
const SILENT_MS = 30_000;
const AWAKE_EVERY_MS = 1_000;

/** How long to wait before the nth attempt in a row, n from 0. */
export function waitBefore(attempt: number): number {
  return Math.min(FIRST_WAIT_MS * 2 ** attempt, LONGEST_WAIT_MS);
}

export interface Listener {
  onMessage(message: Message): void;
  onConnection(connected: boolean): void;
}

/** Returns a function that ends it. */
export function openStream(listener: Listener): () => void {
  let socket: WebSocket | null = null;
  let attempts = 0;
  let timer: number | undefined;
  let silence: number | undefined;
  let ended = false;

  let before_ms = slept_ms();
  const awake = window.setInterval(() => {
    const has_slept = slept_ms() > before_ms;
    before_ms = slept_ms();
    if (has_slept && socket?.readyState === WebSocket.OPEN) lost(socket);
  }, AWAKE_EVERY_MS);

  const heard = () => {
    window.clearTimeout(silence);
    silence = window.setTimeout(() => socket && lost(socket), SILENT_MS);
  };
  const connect = () => {
    const address = new URL("api/v1/stream?without_static=*", location.href);
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    socket = new WebSocket(address.href);
    socket.onopen = () => {
      attempts = 0;
      heard();
      listener.onConnection(true);
    };
    socket.onmessage = (event) => {
      heard();
      listener.onMessage(JSON.parse(event.data) as Message);
    };
    const opened = socket;
    socket.onclose = () => lost(opened);
  };
  /** Not before the line itself is known to be dead: a machine that slept hears that late. */
  const lost = (line: WebSocket) => {
    line.onclose = line.onmessage = null;
    line.close();
    window.clearTimeout(silence);
    if (ended) return;
    listener.onConnection(false);
    timer = window.setTimeout(connect, waitBefore(attempts++));
  };
  connect();
  return () => {
    ended = true;
    window.clearTimeout(timer);
    window.clearInterval(awake);
    socket?.close();
  };
}
