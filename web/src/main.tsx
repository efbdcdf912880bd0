import { StrictMode } from "react";
import { createRoot } from "react-dom/client";
import { App } from "./App";
import { tabMemory } from "./command/command";
import { OperatorContext } from "./context";
import { Operator } from "./operator";
import { language } from "./text/words";
import "./styles/tokens.css";
import "./styles/base.css";
import "./styles/table.css";
import "./styles/top.css";
import "./styles/layout.css";
import "./styles/shell.css";
import "./styles/plan.css";
import "./styles/reconstruct.css";
import "./styles/library.css";
import "./styles/replay.css";
import "./styles/judge.css";
import "./styles/setup.css";
import "./styles/floor.css";
import "./styles/fly.css";
import "./styles/pick.css";
import "./styles/mission.css";
import "./styles/field.css";
import "./styles/log.css";
import "./styles/preflight.css";
import "./styles/failsafe.css";
import "./styles/calibration.css";

const root = document.getElementById("root");
if (root === null) throw new Error("index.html has no element #root");

const operator = new Operator(location, tabMemory(window));
operator.start();
document.documentElement.lang = language;
window.addEventListener("pagehide", (event) => {
  // A page kept for the back button comes back with its socket; only a page that ends closes it.
  if (!event.persisted) operator.leave();
});

createRoot(root).render(
  <StrictMode>
    <OperatorContext value={operator}>
      <App />
    </OperatorContext>
  </StrictMode>,
);
