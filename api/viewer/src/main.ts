import "./style.css";
import { App } from "./actions/app.ts";
import { start } from "./actions/sessions.ts";
import { Page } from "./ui/page.ts";

const app = new App();
const root = document.querySelector<HTMLElement>("#app");
if (!root) throw new Error("the page has no element #app");
new Page(app, root);

await start(app);
