/** Where the page begins. */

import { App } from './app';
import { hook } from './hook';
import { selfTest } from './selftest';

const canvas = document.getElementById('view') as HTMLCanvasElement;
const page = document.getElementById('page') as HTMLElement;
const app = new App(canvas, page);
hook(app);
if (new URLSearchParams(location.search).has('selftest')) selfTest(app, page);
else app.start();
