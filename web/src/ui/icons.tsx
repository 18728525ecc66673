// Line icons, drawn for this page on a grid of 24.

import type { ComponentChildren } from "preact";

const SHAPES: Record<string, ComponentChildren> = {
  bell: <path d="M6 16.500V11a6 6 0 0 1 12 0v5.500l1.500 2h-15zM10 21h4" />,
  layers: <path d="m12 4 8.500 4.500L12 13 3.500 8.500zM4 12.800l8 4.200 8-4.200M4 16.500l8 4.200 8-4.200" />,
  download: <path d="M12 4v11m-4.500-4.500L12 15l4.500-4.500M5 19.500h14" />,
  gear: <><path d="M4 7h9m5 0h2M4 17h3m5 0h8M4 12h1m5 0h10" /><circle cx="15.500" cy="7" r="2" /><circle cx="9.500" cy="17" r="2" /><circle cx="7.500" cy="12" r="2" /></>,
  help: <><circle cx="12" cy="12" r="8.500" /><path d="M9.600 9.500a2.500 2.500 0 1 1 3.600 2.300c-.8.4-1.200 1-1.200 1.900M12 16.800v.1" /></>,
  play: <path d="M8 5.500v13l10.500-6.500z" fill="currentColor" />,
  pause: <path d="M8.500 6v12M15.500 6v12" stroke-width="3" />,
  back: <path d="M17.500 6v12L9 12zM6.500 6v12" />,
  forward: <path d="M6.500 6v12L15 12zM17.500 6v12" />,
  close: <path d="m6 6 12 12M18 6 6 18" />,
  plus: <path d="M12 5v14M5 12h14" />,
  minus: <path d="M5 12h14" />,
  north: <path d="m12 3.500 5 16-5-3.500-5 3.500z" />,
  tilt: <path d="M3.500 17 9 8h11.500L15 17zM12 4v1.500" />,
  home: <path d="M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5" />,
  draw: <path d="m5 6 8-2 6 7-5 8-9-3zM5 6h.01M13 4h.01M19 11h.01M14 19h.01M5 16h.01" stroke-linejoin="round" />,
  lock: <><rect x="5.500" y="10.500" width="13" height="9.500" rx="1.500" /><path d="M8.500 10.500V8a3.500 3.500 0 0 1 7 0v2.500" /></>,
  unlock: <><rect x="5.500" y="10.500" width="13" height="9.500" rx="1.500" /><path d="M8.500 10.500V8a3.500 3.500 0 0 1 6.800-1.200" /></>,
  copy: <><rect x="8.500" y="8.500" width="11" height="11" rx="1.500" /><path d="M15.500 8.500V6A1.500 1.500 0 0 0 14 4.500H6A1.500 1.500 0 0 0 4.500 6v8A1.500 1.500 0 0 0 6 15.500h2.500" /></>,
  check: <path d="m5 12.500 4.500 4.500L19 7.500" />,
  drone: <><circle cx="6" cy="6.500" r="2.700" /><circle cx="18" cy="6.500" r="2.700" /><circle cx="6" cy="17.500" r="2.700" /><circle cx="18" cy="17.500" r="2.700" /><path d="m8 8.500 8 7M16 8.500l-8 7" /></>,
  target: <><circle cx="12" cy="12" r="6.500" /><path d="M12 3v4M12 17v4M3 12h4M17 12h4" /></>,
  eye: <><path d="M3 12c2.500-4 5.500-6 9-6s6.500 2 9 6c-2.500 4-5.500 6-9 6s-6.500-2-9-6z" /><circle cx="12" cy="12" r="2.700" /></>,
  "eye-off": <path d="M3 12c2.500-4 5.500-6 9-6s6.500 2 9 6c-2.500 4-5.500 6-9 6s-6.500-2-9-6zM5 19.500 19 4.500" />,
  warning: <path d="M12 4.500 21 19.500H3zM12 10v4.500M12 17v.1" />,
  link: <path d="M10 14a4 4 0 0 0 6 .4l3-3a4 4 0 0 0-5.700-5.700l-1.300 1.300M14 10a4 4 0 0 0-6-.4l-3 3a4 4 0 0 0 5.700 5.700l1.300-1.300" />,
  book: <path d="M5 5.500c3-1 5-.5 7 1 2-1.500 4-2 7-1v13c-3-1-5-.5-7 1-2-1.500-4-2-7-1zM12 6.500v13" />,
};

export type IconName = keyof typeof SHAPES;

export function Icon({ name, size = 16 }: { name: IconName; size?: number }) {
  return (
    <svg class="icon" width={size} height={size} viewBox="0 0 24 24" fill="none" stroke="currentColor" stroke-width="1.800" stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">
      {SHAPES[name]}
    </svg>
  );
}
