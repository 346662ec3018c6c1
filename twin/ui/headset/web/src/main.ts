/** Entry point of the page. */

import { App } from './app';
import { hook } from './hook';
import { SelfTest } from './selftest';

const canvas = document.getElementById('view') as HTMLCanvasElement;
const page = document.getElementById('page') as HTMLElement;
const app = new App(canvas, page);
hook(app);
app.start();
if (new URLSearchParams(location.search).has('selftest')) window.twin.test = new SelfTest(app, page);
