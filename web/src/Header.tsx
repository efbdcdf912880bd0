import { useState } from "react";
import { BASE } from "./api/base";
import { AskingBand, CommandPill } from "./command/CommandPill";
import { useConsole, useOperator } from "./context";
import { Icon } from "./design/Icon";
import { Logo } from "./design/Logo";
import { useNow } from "./design/useNow";
import { countdownWord } from "./failsafe/CountdownNote";
import { silenceCountdown } from "./failsafe/failsafes";
import { anyFlying } from "./fly/activity";
import { HeldBanner } from "./fly/HeldBanner";
import { StopBar } from "./fly/StopBar";
import { Nav } from "./shell/Nav";
import type { Screen } from "./shell/screens";
import type { ConsoleState } from "./state/state";
import { words } from "./text/words";

/** Drones report five times a second; a stream this quiet deserves a word. */
const SILENT_S = 3;

/** Name, connection, stops, and below them whatever the operator must not overlook. */
export function Header({ screen }: { readonly screen: Screen }) {
  return (
    <header className="top">
      <div className="top-line">
        <div className="brand">
          <Logo />
          <h1>{words.title}</h1>
          <ConnectionPill />
          <CommandPill />
        </div>
        <StopBar />
      </div>
      <Nav screen={screen} />
      <HeldBanner />
      <AskingBand />
      <ConnectionBand />
      <Alarms />
    </header>
  );
}

function ConnectionPill() {
  const connection = useConsole((state) => state.connection);
  const lastMs = useConsole((state) => state.lastMessageMs);
  const nowMs = useNow(1000);
  const silentS = lastMs === null ? 0 : Math.floor((nowMs - lastMs) / 1000);
  const silent = connection.kind === "open" && silentS >= SILENT_S;
  const [shownMs] = useState(() => Date.now());
  const shownS = Math.floor((nowMs - shownMs) / 1000);
  const { tone, word } = pillFace(connection, silent, silentS, shownS);
  return (
    <span
      className={`pill pill-${tone}`}
      role="status"
      data-testid="connection"
      data-state={connection.kind}
    >
      {word}
    </span>
  );
}

function pillFace(connection: ConsoleState["connection"], silent: boolean, silentS: number, shownS: number) {
  const text = words.connection;
  switch (connection.kind) {
    case "connecting":
      return { tone: "busy", word: shownS < SILENT_S ? text.connecting : text.connectingFor(shownS) };
    case "open":
      return silent
        ? { tone: "busy", word: text.silent(silentS) }
        : { tone: "good", word: text.open };
    case "lost":
      return { tone: "bad", word: text.lost };
    case "signed_out":
      return { tone: "bad", word: text.signedOut };
  }
}

function ConnectionBand() {
  const connection = useConsole((state) => state.connection);
  const nowMs = useNow(1000);
  const text = words.connection;
  if (connection.kind === "signed_out") {
    return (
      <div className="band band-bad" role="alert">
        <Icon name="warning" />
        <span className="band-text">{text.signedOutText}</span>
        <a className="button" href={`${BASE}/`}>
          {text.signIn}
        </a>
      </div>
    );
  }
  if (connection.kind !== "lost") return null;
  const seconds = Math.max(0, Math.round((nowMs - connection.sinceMs) / 1000));
  const retryS = Math.floor((connection.retryMs - nowMs) / 1000);
  return (
    <div className="band band-bad" role="alert">
      <Icon name="warning" />
      <span className="band-text">
        {text.lostText}
        <Silence sinceMs={connection.sinceMs} nowMs={nowMs} />
      </span>
      {/* A screen reader shall not say the alert again every second. */}
      <span className="band-count" aria-hidden="true">
        {text.lostFor(seconds)}, {retryS > 0 ? text.retryIn(retryS) : text.retrying}
      </span>
    </div>
  );
}

/** Without a line the operator in command is silent, and the server has an answer to that. */
function Silence({ sinceMs, nowMs }: { readonly sinceMs: number; readonly nowMs: number }) {
  const counts = useConsole((state) => state.inCommand && anyFlying(state.drones));
  const table = useConsole((state) => state.failsafeTable);
  if (!counts || table === null) return null;
  const next = silenceCountdown(table, Math.max(0, nowMs - sinceMs) / 1000);
  return next === null ? null : (
    <strong data-testid="silence" aria-hidden="true">
      {" "}
      {words.connection.answers(countdownWord(next))}
    </strong>
  );
}

function Alarms() {
  const operator = useOperator();
  const alarms = useConsole((state) => state.alarms);
  return alarms.map((alarm) => (
    <div key={alarm.id} className="band band-alarm" role="alert" data-testid="alarm">
      <Icon name="error" />
      <strong className="band-text">{alarm.text}</strong>
      <button
        type="button"
        className="button"
        onClick={() => {
          operator.dismissAlarm(alarm.id);
        }}
      >
        {words.dismiss}
      </button>
    </div>
  ));
}
