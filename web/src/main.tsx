import { render } from "preact";
import { start } from "./state/session";
import { store } from "./state/store";
import { App } from "./ui/app";
import "./style.css";

declare global {
  interface Window {
    /** For tests, and for whoever looks into the page: what it shows. */
    __crowdfence: typeof store;
  }
}

window.__crowdfence = store;
render(<App />, document.getElementById("page")!);
void start();
