// The WebSocket: it comes back by itself, and says when it is gone.

import type { Message } from "./contract";

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 5_000;
/** The service pings; a connection that is silent for longer is a dead one that nobody closed. */
const SILENT_MS = 30_000;

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

  const heard = () => {
    window.clearTimeout(silence);
    silence = window.setTimeout(() => socket?.close(), SILENT_MS);
  };
  const connect = () => {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    socket = new WebSocket(`${scheme}://${location.host}/api/v1/stream`);
    socket.onopen = () => {
      attempts = 0;
      heard();
      listener.onConnection(true);
    };
    socket.onmessage = (event) => {
      heard();
      listener.onMessage(JSON.parse(event.data) as Message);
    };
    socket.onclose = () => {
      window.clearTimeout(silence);
      if (ended) return;
      listener.onConnection(false);
      timer = window.setTimeout(connect, waitBefore(attempts++));
    };
  };
  connect();
  return () => {
    ended = true;
    window.clearTimeout(timer);
    socket?.close();
  };
}
