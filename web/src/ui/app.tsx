import { useEffect } from "preact/hooks";
import { useStore } from "../state/store";
import { Inspector } from "./inspector";
import { listenToKeys } from "./keys";
import { LeftPanel } from "./left_panel";
import { MapPanel } from "./map_panel";
import { ReasonDialog } from "./operator";
import { Panel } from "./panels";
import { TimelinePanel } from "./timeline";
import { TopBar } from "./top_bar";

export function App() {
  const sides = useStore((state) => state.sides);
  useEffect(listenToKeys, []);
  return (
    <div class={`app ${sides.left ? "" : "no-left"} ${sides.right ? "" : "no-right"}`}>
      <TopBar />
      {sides.left && <LeftPanel />}
      <MapPanel />
      {sides.right && <Inspector />}
      <TimelinePanel />
      <Panel />
      <ReasonDialog />
      <Notices />
    </div>
  );
}

function Notices() {
  const notices = useStore((state) => state.notices);
  return (
    <div class="notices" aria-live="polite">
      {notices.map(({ id, level, text }) => (
        <p key={id} class={level} data-test="notice">
          {text}
        </p>
      ))}
    </div>
  );
}
