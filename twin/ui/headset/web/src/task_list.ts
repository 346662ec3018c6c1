/** The tasks of a scene that the page can start; above the picture while there is no task. */

import type { App } from './app';
import type { Button } from './controls';

/** Return a button for each task of the scene, and one for no task; none if the server shows only one exercise. */
export function taskButtons(app: App): Button[] {
  const choice = app.console?.info.choice;
  if (!choice) return [];
  const button = (name: string | null, title: string, hint: string): Button => ({
    kind: 'button',
    id: name === null ? 'start-none' : `start-${name}`,
    label: () => title,
    on: () => choice.present === name,
    off: () => app.model.leaving || choice.present === name,
    press: () => void app.ask('task', { do: 'start', name }),
    hint,
  });
  const tasks = choice.tasks.map(([name, title]) =>
    button(name, `${title.charAt(0).toUpperCase()}${title.slice(1)}`, 'Start this task: the page then shows its steps and its clock'),
  );
  return [...tasks, button(null, 'No task', 'Move the instruments freely, without steps, clock and result')];
}

export class TaskList {
  readonly box = document.createElement('details');
  private built = false;

  constructor(private readonly app: App) {
    this.box.className = 'task-list';
    this.box.dataset['id'] = 'tasks';
    this.box.hidden = true;
    // on a small screen the list would cover the picture
    this.box.open = window.matchMedia('(min-width: 1101px) and (min-height: 700px)').matches;
    const head = document.createElement('summary');
    head.textContent = 'Start a task';
    this.box.append(head);
  }

  refresh(): void {
    const choice = this.app.console?.info.choice ?? null;
    this.box.hidden = choice === null || choice.present !== null;
    for (const node of this.box.querySelectorAll('button')) node.disabled = this.app.model.leaving;
    if (this.built || !choice) return;
    this.built = true;
    for (const task of taskButtons(this.app)) {
      if (task.id === 'start-none') continue; // there is no task while this list is shown
      const node = document.createElement('button');
      node.className = 'push';
      node.dataset['id'] = `top-${task.id}`;
      node.textContent = task.label();
      node.title = task.hint;
      node.onclick = () => task.press();
      this.box.append(node);
    }
  }
}
