import type { App } from './app';
export function selfTest(app: App, _page: HTMLElement): void { app.start(); }
