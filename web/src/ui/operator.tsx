// What an operator does to zones and drones. Every action says who and why, and the service keeps it.

import { actOnDrone, actOnZone, addZone, type DroneAction, type ZoneAction } from "../api/client";
import type { Corner, Drone, Scene, Zone } from "../api/contract";
import { goLive, notify, reasonOf, select, zonesChanged } from "../state/session";
import { store, useStore } from "../state/store";
import { area } from "../text/units";
import { ringArea } from "../map/geometry";
import { useEffect, useRef, useState } from "preact/hooks";

export function mayOperate(scene: Scene | null): boolean {
  return scene?.role === "operator";
}

interface Question {
  title: string;
  text: string;
  verb: string;
  danger: boolean;
  restriction: boolean;
  answer(reason: string, restriction: string): Promise<void>;
}

let ask: (question: Question | null) => void = () => {};

export const LEAST_REASON = 3;
const STRICTEST = "prohibited";

export async function askForZone(corners: Corner[]): Promise<void> {
  const size = area(ringArea(corners), store.state.units);
  ask({
    title: "Close this ground",
    text: `${size} are closed until an operator dismisses the zone. Everybody who asks for zones gets it.`,
    verb: "Close",
    danger: false,
    restriction: true,
    answer: async (reason, restriction) => {
      const zone = await addZone(corners, reason, restriction);
      // It is closed now: a page that stays in the past would say that there is no such zone.
      if (!store.state.time.following) goLive();
      await zonesChanged();
      select({ kind: "zone", id: zone.id });
      notify(`${zone.id} is closed.`);
    },
  });
}

const ACTIONS: Record<ZoneAction, { verb: string; danger: boolean; done: string; text: (zone: Zone) => string }> = {
  lock: { verb: "Lock", danger: false, done: "is locked", text: (zone) => `${zone.id} stays closed whatever drones see, until an operator unlocks it.` },
  unlock: { verb: "Unlock", danger: true, done: "is unlocked", text: (zone) => `${zone.id} may end again when drones find its ground below the threshold.` },
  dismiss: {
    verb: "Dismiss",
    danger: true,
    done: "is dismissed",
    text: (zone) =>
      zone.kind === "operator"
        ? `The ground of ${zone.id} is opened.`
        : `You say that the crowd in ${zone.id} is none. Crowd that drones still see stays out of the zones as an exception for a limited time only.`,
  },
};

export function askAbout(zone: Zone, action: ZoneAction): void {
  const { verb, danger, done, text } = ACTIONS[action];
  // While the reason is written crowd may come to it that nobody has looked at.
  const seen_ns = store.state.moment?.stamp_ns;
  const more: Record<string, string> = action === "dismiss" && seen_ns ? { seen_ns } : {};
  ask({
    title: `${verb} ${zone.id}`,
    text: text(zone),
    verb,
    danger,
    restriction: false,
    answer: async (reason) => {
      await actOnZone(zone.id, action, reason, more);
      await zonesChanged();
      notify(`${zone.id} ${done}.`);
    },
  });
}

export function askAboutDrone({ drone, left_out }: Drone): void {
  const action: DroneAction = left_out ? "take-in" : "leave-out";
  ask({
    title: left_out ? `Take ${drone} in again` : `Leave ${drone} out`,
    text: left_out
      ? `The looks of ${drone} count again: ground that it sees empty may open.`
      : `The looks of ${drone} do not count until it is taken in again, because it sees nothing. What is closed stays closed; what it alone has in view is seen by nobody.`,
    verb: left_out ? "Take in" : "Leave out",
    danger: left_out !== null,
    restriction: false,
    answer: async (reason) => {
      await actOnDrone(drone, action, reason);
      notify(left_out ? `${drone} counts again.` : `${drone} is left out.`);
    },
  });
}

export function ReasonDialog() {
  const [question, setQuestion] = useState<Question | null>(null);
  const [reason, setReason] = useState("");
  const [restriction, setRestriction] = useState(STRICTEST);
  const [refusal, setRefusal] = useState("");
  const [sent, setSent] = useState(false);
  const dialog = useRef<HTMLDialogElement>(null);
  const asked = useRef<Question | null>(null);
  const user = useStore((state) => state.scene?.user ?? "");
  ask = (next) => {
    setReason("");
    setRestriction(STRICTEST); // what was chosen for other ground says nothing of this
    setRefusal("");
    setSent(false);
    setQuestion(next);
  };
  useEffect(() => {
    if (question) dialog.current?.showModal();
  }, [question]);
  asked.current = question;
  if (!question) return null;
  /** On a slow line the next question may stand there when this one is answered. */
  const isAsked = () => asked.current === question;
  const close = () => isAsked() && setQuestion(null);
  const cancel = () => {
    // What is on its way is not held back by closing this.
    if (sent) notify(`${question.title}: it was sent already, and may still be done.`, "error");
    close();
  };
  const submit = (event: Event) => {
    event.preventDefault();
    setSent(true);
    question
      .answer(reason.trim(), restriction)
      .then(close)
      .catch((error) => {
        if (!isAsked()) return notify(`${question.title}: ${reasonOf(error)}`, "error");
        setRefusal(reasonOf(error));
        setSent(false);
      });
  };
  return (
    <dialog ref={dialog} class="dialog" onClose={cancel} data-test="reason-dialog">
      <form onSubmit={submit}>
        <h2>{question.title}</h2>
        <p>{question.text}</p>
        {question.restriction && (
          <label>
            Restriction
            <select value={restriction} onChange={(event) => setRestriction(event.currentTarget.value)}>
              <option value={STRICTEST}>no flight at all</option>
              <option value="no_sustained_flight">no sustained flight</option>
            </select>
          </label>
        )}
        <label>
          Reason
          <textarea autofocus required rows={3} minLength={LEAST_REASON} maxLength={500} value={reason} onInput={(event) => setReason(event.currentTarget.value)} placeholder="What you know that the drones do not" />
        </label>
        <p class="signed">
          Kept in the audit log with the name <b>{user}</b> and the time.
        </p>
        {refusal && <p class="refusal">{refusal}</p>}
        <footer>
          <button type="button" onClick={cancel}>
            Cancel
          </button>
          <button type="submit" class={question.danger ? "danger" : "primary"} disabled={sent || reason.trim().length < LEAST_REASON}>
            {question.verb}
          </button>
        </footer>
      </form>
    </dialog>
  );
}
