import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { openStream } from "../src/api/stream";

class Line {
  static readonly OPEN = 1;
  static all: Line[] = [];
  readyState = Line.OPEN;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: string }) => void) | null = null;
  onclose: (() => void) | null = null;
  constructor(readonly address: string) {
    Line.all.push(this);
  }
  /** Of a dead line nobody hears. */
  close(): void {}
}

describe("a stream", () => {
  let told: boolean[];
  beforeEach(() => {
    vi.useFakeTimers();
    vi.stubGlobal("WebSocket", Line);
    vi.stubGlobal("window", globalThis);
    vi.stubGlobal("location", { href: "https://field.test/crowd/?a=b#c" });
    Line.all = [];
    told = [];
  });
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });
  const opened = () => {
    const end = openStream({ onMessage: () => {}, onConnection: (connected) => told.push(connected) });
    Line.all[0].onopen!();
    return end;
  };

  it("is beside the page, also under the path of a proxy", () => {
    const end = opened();
    expect(Line.all[0].address).toBe("wss://field.test/crowd/api/v1/stream?without_static=*");
    end();
  });

  it("is lost as soon as the machine wakes that slept, and comes back", () => {
    const end = opened();
    vi.advanceTimersByTime(20_000);
    expect(told).toEqual([true]);
    vi.setSystemTime(Date.now() + 600_000); // the clock on the wall alone
    vi.advanceTimersByTime(1_000);
    expect(told).toEqual([true, false]);
    vi.advanceTimersByTime(500);
    expect(Line.all.length).toBe(2);
    Line.all[1].onopen!();
    vi.advanceTimersByTime(10_000);
    expect(told).toEqual([true, false, true]);
    end();
  });

  it("is lost where it is silent, without waiting for a line that is dead", () => {
    const end = opened();
    vi.advanceTimersByTime(29_000);
    Line.all[0].onmessage!({ data: '{"type": "ping"}' });
    vi.advanceTimersByTime(29_000);
    expect(told).toEqual([true]);
    vi.advanceTimersByTime(1_000);
    expect(told).toEqual([true, false]);
    Line.all[0].onclose?.();
    expect(told).toEqual([true, false]);
    end();
  });
});
