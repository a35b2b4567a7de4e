import './styles/tokens.css';
import './styles/base.css';
import './styles/controls.css';
import { mount } from 'svelte';
import Shell from './Shell.svelte';
import { App } from './lib/app';

mount(Shell, { target: document.getElementById('app')!, props: { app: new App() } });
